"""Sentences on unidentifiable photometric parameters, with the capture that determines each."""

from __future__ import annotations

from collections.abc import Sequence

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
    CapturedImage,
    ambient,
    black_name,
)
from starling.calibration.solution import Estimate

_TOGETHER = 0.98  # Correlation above which two parameters are confounded.
BLACK_DN = 1.0  # Standard deviation above which a black level counts as unknown.
EVEN = 12**-0.5  # Standard deviation of a uniform distribution over its range.
_RANGE = {VIGNETTING: 20.0, FALLOFF: 20.0, BLUR: 20.0, HAZE: 1.0}  # Maximum; the minimum is 0.
_BELOW_DN = 1.0  # Permitted excess of a black level over the darkest pixels.


def sentences(
    estimates: Sequence[Estimate],
    covariance: NDArray[np.float64],
    *,
    images: Sequence[CapturedImage],
    power_w: float,
    means: bool,
) -> tuple[str, ...]:
    """Describe the unidentifiable parameters.

    Args:
        estimates: estimates of the fit; a fixed parameter has an infinite deviation.
        covariance: (n, n) covariance of the estimates.
        images: fitted images.
        power_w: power of the projector, which is kept.
        means: whether only tiles' mean levels were compared.
    """
    held = {estimate.name for estimate in estimates if not np.isfinite(estimate.sd)}
    texts = []
    if POWER in held:
        texts.append(_power(images, power_w))
    if VIGNETTING in held:
        texts.append(
            f"{VIGNETTING} and reflectance cannot be separated: the initial value was kept."
        )
    if means:
        texts.append(
            f"{BLUR} is not determined, because the images do not match the pattern (correlation "
            "below 0.3) and dots were not used: calibrate geometry and pattern first."
        )
    unseparated = [name for name in held if "irradiance" in name]
    if unseparated:
        texts.append(
            f"{', '.join(unseparated)} cannot be separated from reflectance: also capture with the "
            "emitter off, or calibrate the pattern, so that dots can be used."
        )
    texts += _background(estimates, images)
    texts += _wide(estimates)
    texts += _black(estimates, images)
    texts += _pairs(estimates, covariance)
    return tuple(texts)


def _power(images: Sequence[CapturedImage], power_w: float) -> str:
    text = (
        f"{POWER} (gain, exposure) and reflectance cannot be separated: {POWER} = {power_w:g} W "
        "was kept, and ambient irradiance is relative to it."
    )
    if all(image.on for image in images):
        text += " Captures with the emitter off make the ratio independent of the dots' shape."
    return text


def _background(estimates: Sequence[Estimate], images: Sequence[CapturedImage]) -> list[str]:
    """Report ambient light that is confounded with haze.

    Both are uniform light on surfaces of free reflectance. Only their change with distance
    separates them, which requires haze to be fitted.
    """
    dark = {image.scene for image in images if not image.on}
    determined = {estimate.name for estimate in estimates if np.isfinite(estimate.sd)}
    if HAZE in determined:
        return []
    names = [ambient(scene) for scene in dict.fromkeys(image.scene for image in images if image.on)]
    confounded = [
        n for n in names if n in determined and n not in {ambient(scene) for scene in dark}
    ]
    if not confounded:
        return []
    return [
        f"{', '.join(confounded)} and {HAZE} cannot be separated: {HAZE} was fixed; free "
        "photometry, or also capture with the emitter off."
    ]


def _wide(estimates: Sequence[Estimate]) -> list[str]:
    """Report parameters whose standard deviation exceeds that of their range."""
    return [
        f"{estimate.name} is not determined: its standard deviation of {estimate.sd:.2g} exceeds "
        f"that of its range from 0 to {_RANGE[estimate.name]:g}; capture surfaces that fill the "
        "image, at several distances."
        for estimate in estimates
        if estimate.name in _RANGE
        and np.isfinite(estimate.sd)
        and estimate.sd > EVEN * _RANGE[estimate.name]
    ]


def _black(estimates: Sequence[Estimate], images: Sequence[CapturedImage]) -> list[str]:
    texts = []
    for estimate in estimates:
        if estimate.name not in (LEFT_BLACK, RIGHT_BLACK):
            continue
        lowest = min(image.lowest_dn for image in images if black_name(image.side) == estimate.name)
        if estimate.sd > BLACK_DN:
            texts.append(
                f"{estimate.name} and ambient light cannot be separated: {estimate.value:.3g} DN "
                f"was kept, the darkest pixels are at {lowest:.3g} DN; capture surfaces of several "
                "reflectances, or with the lens covered."
            )
        elif estimate.value > lowest + _BELOW_DN + 2 * estimate.sd:
            texts.append(
                f"{estimate.name} = {estimate.value:.3g} DN exceeds the darkest pixels' "
                f"{lowest:.3g} DN, so light is less uniform than assumed: capture with the lens "
                "covered."
            )
    return texts


def _pairs(estimates: Sequence[Estimate], covariance: NDArray[np.float64]) -> list[str]:
    deviation = np.sqrt(np.diagonal(covariance))
    texts = []
    for i, second in enumerate(estimates):
        for j, first in enumerate(estimates[:i]):
            if not (np.isfinite(deviation[i]) and np.isfinite(deviation[j])):
                continue
            correlation = covariance[i, j] / max(deviation[i] * deviation[j], 1e-300)
            if abs(correlation) > _TOGETHER:
                texts.append(
                    f"{first.name} and {second.name} cannot be separated (correlation "
                    f"{correlation:.2f}): capture surfaces at other distances and of other "
                    "reflectances."
                )
    return texts
