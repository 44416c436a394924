"""What captures leave open of the levels' parameters: one sentence each, and what would tell it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from starling.calibration.photometry.light_model import (
    BLUR,
    FALLOFF,
    HAZE,
    LEFT_BLACK,
    POWER,
    RIGHT_BLACK,
    VIGNETTING,
    Image,
    ambient,
    black_name,
)
from starling.calibration.solution import Estimate

_TOGETHER = 0.98  # Correlation from which two parameters are one.
BLACK_DN = 1.0  # Deviation from which a black level is as good as unknown.
EVEN = 12**-0.5  # Deviation of what may lie anywhere in a range, over the range.
_RANGE = {VIGNETTING: 20.0, FALLOFF: 20.0, BLUR: 20.0, HAZE: 1.0}  # Highest value; the lowest is 0.
_BELOW_DN = 1.0  # By which a black level may exceed the darkest pixels'.


def sentences(
    estimates: Sequence[Estimate],
    covariance: NDArray[np.float64],
    *,
    images: Sequence[Image],
    values: Mapping[str, float],
    eliminate: bool,
    means: bool,
    scatter: float | None,
) -> tuple[str, ...]:
    """Name what is open.

    Args:
        estimates: of the fit; an infinite deviation where a parameter was held.
        covariance: of the estimates.
        images: fitted.
        values: of all parameters.
        eliminate: whether each tile had a reflectance of its own.
        means: whether only tiles' mean levels were compared.
        scatter: of the tiles' reflectance over what was given as known, where it was.
    """
    held = {estimate.name for estimate in estimates if not np.isfinite(estimate.sd)}
    found = []
    if eliminate and scatter is not None:
        found.append(
            f"reflectance as given does not fit (surfaces differ from it by {scatter:.0%}): it was "
            "left free, so what rests on it is open; give the surfaces' own reflectance."
        )
    if POWER in held:
        found.append(_power(images, values[POWER], eliminate=eliminate))
    if VIGNETTING in held:
        found.append(
            f"{VIGNETTING} and reflectance cannot be told apart: give reflectance, or capture an "
            "evenly painted wall."
        )
    if means:
        found.append(
            f"{BLUR} is open, and dots were not used: their places in the images are not the "
            "pattern's (correlation below 0.3); calibrate geometry and pattern first."
        )
    lost = [name for name in held if "irradiance" in name]
    if lost:
        found.append(
            f"{', '.join(lost)} cannot be told from reflectance: capture with the emitter off too, "
            "or calibrate the pattern, so that dots tell."
        )
    found += _background(estimates, images) if eliminate else []
    found += _wide(estimates)
    found += _black(estimates, images)
    found += _pairs(estimates, covariance)
    return tuple(found)


def _power(images: Sequence[Image], power_w: float, *, eliminate: bool) -> str:
    relative = f"ambient irradiance is relative to {POWER} = {power_w:g} W"
    if not eliminate:
        return (
            f"{POWER} and exposure cannot be told apart under auto exposure; {relative}: record "
            "exposure_s and gain, or switch auto exposure off."
        )
    if any(not image.on for image in images):
        return (
            f"{POWER} and reflectance cannot be told apart; {relative}: give reflectance of one "
            "surface (a grey card)."
        )
    return (
        f"{POWER} (gain, exposure) and reflectance cannot be told apart; {relative}: give "
        "reflectance; with the emitter off too the ratio no longer rests on the dots' shape."
    )


def _background(estimates: Sequence[Estimate], images: Sequence[Image]) -> list[str]:
    """Even light is even light, whose reflectance is free: the projector's, or the room's.

    Where it is fitted, what tells them apart is how they change with distance.
    """
    dark = {image.scene for image in images if not image.on}
    told = {estimate.name for estimate in estimates if np.isfinite(estimate.sd)}
    if HAZE in told:
        return []
    names = [ambient(scene) for scene in dict.fromkeys(image.scene for image in images if image.on)]
    kept = [n for n in names if n in told and n not in {ambient(scene) for scene in dark}]
    if not kept:
        return []
    return [
        f"{', '.join(kept)} and {HAZE} cannot be told apart: {HAZE} was held; free photometry, or "
        "capture with the emitter off too."
    ]


def _wide(estimates: Sequence[Estimate]) -> list[str]:
    """What is known less than by its range alone."""
    return [
        f"{one.name} is open: its deviation of {one.sd:.2g} is more than its range from 0 to "
        f"{_RANGE[one.name]:g} leaves; capture surfaces that fill the image, at several distances."
        for one in estimates
        if one.name in _RANGE and np.isfinite(one.sd) and one.sd > EVEN * _RANGE[one.name]
    ]


def _black(estimates: Sequence[Estimate], images: Sequence[Image]) -> list[str]:
    found = []
    for estimate in estimates:
        if estimate.name not in (LEFT_BLACK, RIGHT_BLACK):
            continue
        lowest = min(image.lowest_dn for image in images if black_name(image.side) == estimate.name)
        if estimate.sd > BLACK_DN:
            found.append(
                f"{estimate.name} and ambient light cannot be told apart: {estimate.value:.3g} DN "
                f"was held, the darkest pixels are at {lowest:.3g} DN; capture surfaces of several "
                "reflectances, or with the lens covered."
            )
        elif estimate.value > lowest + _BELOW_DN + 2 * estimate.sd:
            found.append(
                f"{estimate.name} = {estimate.value:.3g} DN exceeds the darkest pixels' "
                f"{lowest:.3g} DN, so light is not as even as assumed: capture with the lens "
                "covered."
            )
    return found


def _pairs(estimates: Sequence[Estimate], covariance: NDArray[np.float64]) -> list[str]:
    deviation = np.sqrt(np.diagonal(covariance))
    found = []
    for i, one in enumerate(estimates):
        for j, other in enumerate(estimates[:i]):
            if not (np.isfinite(deviation[i]) and np.isfinite(deviation[j])):
                continue
            together = covariance[i, j] / max(deviation[i] * deviation[j], 1e-300)
            if abs(together) > _TOGETHER:
                found.append(
                    f"{other.name} and {one.name} cannot be told apart (correlation "
                    f"{together:.2f}): capture surfaces at other distances and of other "
                    "reflectances."
                )
    return found
