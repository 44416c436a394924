"""Whether infrared pairs and reference depth tell of the same scenes, in the same unit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from starling.calibration.correlation import WINDOW_PX
from starling.calibration.plausibility.correspondence import Correspondences
from starling.patterns.errors import refuse

FEWEST = 20  # Windows of a scene below which nothing is said of it.
_YAW = np.deg2rad(0.12)  # Disparities agree if they differ by what this turn of an imager does,
_READ_PX = 0.5  # by what a window may be misread,
_APART = 0.05  # or by this share of them.
_AGREEING = 0.5  # Share of a scene's windows that must agree.
_DOUBTED = 0.9  # A smaller share is said.
_KINK = 0.15  # Share by which disparity may vary in a window that is compared.
_KNOWN = 0.9  # Share of a window's pixels whose reference must be known.
_REFUSED = 0.25  # A scale off by more is no tolerance of a camera; units are 2.54 or more apart.
_SAID = 0.02  # A scale off by more is said: captured rooms are off by at most 0.6 %.


@dataclass(frozen=True, kw_only=True, slots=True)
class Scale:
    """How the disparities of one scene compare with what its reference depth means."""

    scene: str
    ratio: float  # Median of measured over reference disparity.
    agreeing: float  # Share of the places that agree with the ratio, 0 ... 1.
    places: int  # Windows or pixels that were compared.
    disparity_px: float  # Median of the measured ones.
    apart_px: float  # Difference that counts as agreement, whatever the disparity.


def measure(
    scene: str, found: Correspondences, reference_px: NDArray, focal_px: float
) -> Scale | None:
    """Compare measured disparities with a reference.

    Windows count whose reference is known in 90 % of the pixels and varies by at most 15 %. Two
    disparities agree if they differ by at most 5 %, by what 0.12 degree of yaw between the
    imagers does (1.9 px at a focal length of 900 px), or by 0.5 px.

    Args:
        scene: its name.
        found: correspondences of its infrared pair.
        reference_px: (h, w) disparity that the reference depth means [px], NaN where unknown.
        focal_px: of the imagers.

    Returns:
        None where fewer than 20 windows can be compared.
    """
    reference = np.array(
        [_level(reference_px, *centre) for centre in zip(found.row, found.column, strict=True)]
    )
    return compare(scene, found.disparity_px, reference, focal_px)


def compare(
    scene: str, measured_px: NDArray, reference_px: NDArray, focal_px: float
) -> Scale | None:
    """Compare disparities with a reference, place by place (see `measure`).

    Args:
        scene: its name.
        measured_px: (n,) [px]; what is not above 0 does not count.
        reference_px: (n,) at the same places, NaN where unknown.
        focal_px: of the imagers.

    Returns:
        None where fewer than 20 places can be compared.
    """
    counted = np.isfinite(reference_px) & (measured_px > 0)
    if np.count_nonzero(counted) < FEWEST:
        return None
    measured = measured_px[counted].astype(np.float64)
    reference = reference_px[counted].astype(np.float64)
    ratio = float(np.median(measured / reference))
    apart = np.abs(measured - ratio * reference)
    apart_px = max(_READ_PX, float(_YAW) * focal_px)
    agreeing = float(np.mean(apart <= np.maximum(apart_px, _APART * measured)))
    return Scale(
        scene=scene,
        ratio=ratio,
        agreeing=agreeing,
        places=len(measured),
        disparity_px=float(np.median(measured)),
        apart_px=apart_px,
    )


def refuse_swapped(scene: str, found: Correspondences) -> None:
    """Refuse a pair whose images are swapped or the same.

    Rectified, everything lies further left in the right image: x_left - x_right >= 0. Swapped:
    more than half of at least 20 windows are found more than 1 px the other way (2 % at most in
    captured rooms); the same: more than half within 0.5 px of their own place.

    Raises:
        InputError: if it is so.
    """
    if len(found) < FEWEST:
        return
    other_way = float(np.mean(found.disparity_px < -1))
    if other_way > 0.5:
        raise refuse(
            f"left and right images of scene {scene}",
            "must not be swapped",
            f"{other_way:.0%} of {len(found)} windows further right in the right image",
            "Exchange ir_left.png and ir_right.png.",
        )
    unmoved = float(np.mean(np.abs(found.disparity_px) < 0.5))
    if unmoved > 0.5:
        raise refuse(
            f"left and right images of scene {scene}",
            "must be two views",
            f"{unmoved:.0%} of {len(found)} windows at one place in both",
            "Is one image saved twice?",
        )


def refuse_out_of_range(
    scene: str, depth_m: NDArray, range_m: tuple[float, float], depth_unit_m: float
) -> None:
    """Refuse depth [m] whose median lies outside a sensor's range: all there is without images.

    A factor of 10 may hide in the range of a sensor that sees from 0.4 to 10 m.

    Raises:
        InputError: if it is so.
    """
    known = depth_m[np.isfinite(depth_m)]
    if known.size == 0:
        return
    (near, far), median = range_m, float(np.median(known))
    if not near <= median <= far:
        raise refuse(
            f"depth of scene {scene}",
            f"must lie within the sensor's {near:g} to {far:g} m",
            f"a median of {median:.4g} m",
            f"Check depth_unit_m in capture.toml ({depth_unit_m:g}).",
        )


def check(scales: tuple[Scale, ...], depth_unit_m: float) -> tuple[str, ...]:
    """Refuse references of other scenes or units than the infrared pairs; say what is doubtful.

    Refused is a scene in which fewer than half of the places agree on one scale, or whose scale
    differs from the others' by more than the same tolerances (see `measure`), and a common scale
    off by more than 25 %. Said is a scene in which fewer than 90 % agree, and a common scale off
    by more than 2 %: a baseline does that as well as a wrong unit, and nothing here tells which.
    In captured rooms with a laser scanner's depth 97 to 100 % agree, scales lie within 0.4 % of
    each other and 0.6 % of 1; another view of the same room agrees in 31 %.

    Args:
        scales: of the scenes.
        depth_unit_m: that the captures claim.

    Returns:
        Warnings.

    Raises:
        InputError: as above.
    """
    if not scales:
        return ()
    for scale in scales:
        _refuse_other_scene(scale)
    common = _refuse_outlier(scales)
    if abs(np.log(common)) > np.log1p(_REFUSED):
        raise refuse(
            "reference depth",
            "must be of the infrared pairs' scale",
            f"depths {common:.4g} times those that the pairs show",
            f"Check depth_unit_m in capture.toml ({depth_unit_m:g}; "
            f"{depth_unit_m / common:.3g} would fit), fx_px and baseline_m.",
        )
    said = [
        f"reference depth of scene {scale.scene} disagrees with its infrared pair in "
        f"{1 - scale.agreeing:.0%} of {scale.places} places: did something move?"
        for scale in scales
        if scale.agreeing < _DOUBTED
    ]
    if abs(common - 1) > _SAID:
        said.append(
            f"disparities are {common:.4f} times what reference depth, fx_px and baseline_m mean: "
            "the fit takes this for a baseline, focal length or yaw that is off; if those are well "
            "known, the depth unit is wrong."
        )
    return tuple(said)


def _refuse_other_scene(scale: Scale) -> None:
    if scale.agreeing < _AGREEING:
        raise refuse(
            f"reference depth of scene {scale.scene}",
            "must show what its infrared pair shows",
            f"{scale.agreeing:.0%} of {scale.places} places that agree",
            "Is one of the two from another pose, camera or time? Leave the scene out.",
        )


def _refuse_outlier(scales: tuple[Scale, ...]) -> float:
    """Scale that most scenes share; refuses one that is off it."""
    ratios = np.array([scale.ratio for scale in scales])
    # The scene nearest to all others: with a mean, one wild scene would make all look wrong. Of
    # two it is the one nearest to 1.
    apart = np.abs(np.log(ratios[:, None] / ratios)).sum(axis=1)
    nearest = np.flatnonzero(apart <= apart.min() + 1e-6)
    centre = scales[int(nearest[np.abs(np.log(ratios[nearest])).argmin()])]
    for scale in scales:
        allowed = max(_APART, scale.apart_px / min(scale.disparity_px, centre.disparity_px))
        if abs(np.log(scale.ratio / centre.ratio)) > np.log1p(allowed):
            raise refuse(
                f"reference depth of scene {scale.scene}",
                f"must be of one scale with the other scenes' ({centre.scene})",
                f"disparities {scale.ratio:.4g} times the reference's, not {centre.ratio:.4g}",
                "Is it of another camera or unit? Leave the scene out.",
            )
    return float(np.median(ratios))


def _level(reference_px: NDArray, row: int, column: int) -> float:
    """Median reference of a window; NaN where it is unknown or bends or jumps in it."""
    half = WINDOW_PX // 2
    window = reference_px[row - half : row + half + 1, column - half : column + half + 1]
    known = window[np.isfinite(window)]
    if known.size < _KNOWN * window.size:
        return float("nan")
    low, level, high = np.percentile(known, (0, 50, 100))
    return float(level) if high - low <= _KINK * level else float("nan")
