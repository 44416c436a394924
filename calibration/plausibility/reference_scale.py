"""Check that infrared pairs and reference depth show the same scenes in the same unit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from starling.calibration.correlation import WINDOW_PX
from starling.calibration.plausibility.correspondence import Correspondences
from starling.patterns.errors import refuse

FEWEST = 20  # Minimum windows of a scene; with fewer, the scene is not checked.
# Two disparities agree if their difference is below any of the next three limits.
_YAW = np.deg2rad(0.12)  # Yaw error of an imager.
_READ_PX = 0.5  # Matching error of a window.
_APART = 0.05  # Relative difference.
_AGREEING = 0.5  # Minimum share of agreeing windows; with fewer, a scene is refused.
_DOUBTED = 0.9  # Share of agreeing windows below which a warning is given.
_KINK = 0.15  # Maximum relative range of disparity in a compared window.
_KNOWN = 0.9  # Minimum share of a window's pixels with a reference.
_REFUSED = 0.25  # Maximum scale error; it exceeds camera tolerances, and units differ by 2.54.
_SAID = 0.02  # Scale error above which a warning is given; captured rooms have at most 0.6 %.


@dataclass(frozen=True, kw_only=True, slots=True)
class ReferenceScale:
    """Measured disparity of one scene relative to its reference depth."""

    scene: str
    ratio: float  # Median of measured over reference disparity.
    agreeing: float  # Share of the places that agree with the ratio, 0 ... 1.
    places: int  # Number of compared windows or pixels.
    disparity_px: float  # Median measured disparity.
    apart_px: float  # Difference that counts as agreement at any disparity.


def measure(
    scene: str, correspondences: Correspondences, reference_px: NDArray, focal_px: float
) -> ReferenceScale | None:
    """Compare the disparity of an infrared pair with a reference.

    A window counts if its reference is known in 90 % of the pixels and varies by at most 15 %.
    Two disparities agree within 5 %, 0.5 px, or the effect of 0.12 degree of yaw. This effect is
    1.9 px at a focal length of 900 px.

    Args:
        scene: name of the scene.
        correspondences: matches of its infrared pair.
        reference_px: (h, w) disparity of the reference depth [px], NaN where unknown.
        focal_px: focal length of the imagers.

    Returns:
        The scale, or None if fewer than 20 windows can be compared.
    """
    reference = np.array(
        [
            _level(reference_px, *centre)
            for centre in zip(correspondences.row, correspondences.column, strict=True)
        ]
    )
    return compare(scene, correspondences.disparity_px, reference, focal_px)


def compare(
    scene: str, measured_px: NDArray, reference_px: NDArray, focal_px: float
) -> ReferenceScale | None:
    """Compare disparities with a reference, place by place (see `measure`).

    Args:
        scene: name of the scene.
        measured_px: (n,) disparity [px]; values up to 0 are ignored.
        reference_px: (n,) reference disparity at the same places [px], NaN where unknown.
        focal_px: focal length of the imagers.

    Returns:
        The scale, or None if fewer than 20 places can be compared.
    """
    counted = np.isfinite(reference_px) & (measured_px > 0)
    if np.count_nonzero(counted) < FEWEST:
        return None
    measured = measured_px[counted].astype(np.float64)
    reference = reference_px[counted].astype(np.float64)
    ratio = float(np.median(measured / reference))
    difference_px = np.abs(measured - ratio * reference)
    tolerance_px = max(_READ_PX, float(_YAW) * focal_px)
    agreeing = float(np.mean(difference_px <= np.maximum(tolerance_px, _APART * measured)))
    return ReferenceScale(
        scene=scene,
        ratio=ratio,
        agreeing=agreeing,
        places=len(measured),
        disparity_px=float(np.median(measured)),
        apart_px=tolerance_px,
    )


def refuse_swapped(scene: str, correspondences: Correspondences) -> None:
    """Refuse a pair with swapped or equal images.

    In a rectified pair, x_left - x_right >= 0. The images are swapped if more than half of at
    least 20 windows have a disparity below -1 px (captured rooms: at most 2 %). They are equal if
    more than half of the windows have a disparity within 0.5 px of 0.

    Raises:
        InputError: if the images are swapped or equal.
    """
    if len(correspondences) < FEWEST:
        return
    reversed_share = float(np.mean(correspondences.disparity_px < -1))
    if reversed_share > 0.5:
        raise refuse(
            f"left and right images of scene {scene}",
            "must not be swapped",
            f"{reversed_share:.0%} of {len(correspondences)} windows with negative disparity",
            "Exchange ir_left.png and ir_right.png.",
        )
    unmoved_share = float(np.mean(np.abs(correspondences.disparity_px) < 0.5))
    if unmoved_share > 0.5:
        raise refuse(
            f"left and right images of scene {scene}",
            "must be two views",
            f"{unmoved_share:.0%} of {len(correspondences)} windows at the same position in both",
            "Check that the two files are not copies of one image.",
        )


def refuse_out_of_range(
    scene: str, depth_m: NDArray, range_m: tuple[float, float], depth_unit_m: float
) -> None:
    """Refuse depth [m] whose median lies outside the sensor's range.

    Without images no stronger check of the unit is possible. A range from 0.4 to 10 m may hide an
    error of a factor of 10.

    Raises:
        InputError: if the median is out of range.
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


def check(scales: tuple[ReferenceScale, ...], depth_unit_m: float) -> tuple[str, ...]:
    """Refuse references of another scene or unit than the infrared pairs; warn if in doubt.

    A scene is refused if fewer than half of its places agree on one scale. It is also refused if
    its scale differs from the other scenes' by more than the tolerances in `measure`. A common
    scale error above 25 % is refused.

    A warning is given for a scene with less than 90 % agreement, and for a common scale error
    above 2 %. A baseline error and a wrong unit have the same effect and cannot be separated here.

    In captured rooms with laser-scanner depth, 97 to 100 % of the places agree. Their scales lie
    within 0.4 % of each other and within 0.6 % of 1. Another view of the same room agrees in 31 %.

    Args:
        scales: scale of each scene.
        depth_unit_m: depth unit in the captures' metadata.

    Returns:
        Warnings.

    Raises:
        InputError: if a scene or the common scale is refused.
    """
    if not scales:
        return ()
    for scale in scales:
        _refuse_other_scene(scale)
    common = _refuse_outlier(scales)
    if abs(np.log(common)) > np.log1p(_REFUSED):
        raise refuse(
            "reference depth",
            "must have the scale of the infrared pairs",
            f"depths {common:.4g} times those of the pairs",
            f"Check depth_unit_m in capture.toml ({depth_unit_m:g}; "
            f"{depth_unit_m / common:.3g} would fit), fx_px and baseline_m.",
        )
    warnings = [
        f"reference depth of scene {scale.scene} disagrees with its infrared pair in "
        f"{1 - scale.agreeing:.0%} of {scale.places} places; check that the scene was static."
        for scale in scales
        if scale.agreeing < _DOUBTED
    ]
    if abs(common - 1) > _SAID:
        warnings.append(
            f"disparities are {common:.4f} times those from reference depth, fx_px and baseline_m: "
            "the fit explains this by an error of baseline, focal length or yaw. If those are "
            "known, the depth unit is wrong."
        )
    return tuple(warnings)


def _refuse_other_scene(scale: ReferenceScale) -> None:
    if scale.agreeing < _AGREEING:
        raise refuse(
            f"reference depth of scene {scale.scene}",
            "must show the same scene as its infrared pair",
            f"{scale.agreeing:.0%} of {scale.places} places that agree",
            "Check that both have the same pose, camera and time, or leave the scene out.",
        )


def _refuse_outlier(scales: tuple[ReferenceScale, ...]) -> float:
    """Return the scale that most scenes share; refuse a scene with another scale."""
    ratios = np.array([scale.ratio for scale in scales])
    # The centre is the scene nearest to all others, because a mean would depend on one outlier.
    # Of two scenes, the centre is the one with its scale nearest to 1.
    distance = np.abs(np.log(ratios[:, None] / ratios)).sum(axis=1)
    candidates = np.flatnonzero(distance <= distance.min() + 1e-6)
    centre = scales[int(candidates[np.abs(np.log(ratios[candidates])).argmin()])]
    for scale in scales:
        allowed = max(_APART, scale.apart_px / min(scale.disparity_px, centre.disparity_px))
        if abs(np.log(scale.ratio / centre.ratio)) > np.log1p(allowed):
            raise refuse(
                f"reference depth of scene {scale.scene}",
                f"must have the scale of the other scenes ({centre.scene})",
                f"disparities {scale.ratio:.4g} times the reference's, not {centre.ratio:.4g}",
                "Check the camera and unit of the reference, or leave the scene out.",
            )
    return float(np.median(ratios))


def _level(reference_px: NDArray, row: int, column: int) -> float:
    """Return the median reference of a window; NaN if it is unknown or varies too much."""
    half = WINDOW_PX // 2
    window = reference_px[row - half : row + half + 1, column - half : column + half + 1]
    known = window[np.isfinite(window)]
    if known.size < _KNOWN * window.size:
        return float("nan")
    low, level, high = np.percentile(known, (0, 50, 100))
    return float(level) if high - low <= _KINK * level else float("nan")
