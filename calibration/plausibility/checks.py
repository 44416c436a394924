"""Whether captures can be what they claim to be, before anything is fitted to them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from starling.calibration.observation import Array, Observation, truth_px
from starling.calibration.plausibility import (
    correspondence,
    depth_spread,
    preset_fit,
    reference_scale,
)
from starling.calibration.plausibility.correspondence import Correspondences
from starling.calibration.plausibility.dots_seen import covered, see
from starling.calibration.plausibility.reference_scale import Scale
from starling.patterns.errors import refuse
from starling.sim.captures.info import CaptureInfo
from starling.sim.sensor.sensor import Sensor

_DOTTED = 0.1  # Share of the windows that must show dots: 0.30 and more in captured rooms.
_FEWEST = 100  # Dots: each read to 0.1 px, together they hold a pose to 0.01 px.
_COVERED = 0.5  # Share of the projector's field below which it is said what stays unknown.
_STEP_PX = 8  # Every eighth pixel of a depth map will do.


def check(observations: Sequence[Observation], sensor: Sensor) -> tuple[str, ...]:
    """Refuse captures that no fit can make sense of; warn of those that leave much open.

    In this order, each with its measured criterion in the module named: a scene of another
    geometry than the first; left and right swapped or the same, reference depth of another
    scene or unit (`reference_scale`); no dots or too few, though the projector is on; another
    model's dots or geometry (`preset_fit`); dots in less than half of the projector's field
    (`dots_seen`); one distance only (`depth_spread`). What needs an image that is missing is
    passed over; the device's own depth stands in for missing reference depth. About 0.3 s a
    scene of 1280x720 on one core.

    Args:
        observations: of one camera, at least one.
        sensor: that is to be fitted.

    Returns:
        Warnings, one sentence or two each.

    Raises:
        InputError: whatever is refused.
    """
    for item in observations:
        _refuse_other_camera(item, observations[0])
    found = [_found(item) for item in observations]
    references = [_reference_px(item) for item in observations]
    scales = [
        _scale(item, places, reference, sensor)
        for item, places, reference in zip(observations, found, references, strict=True)
    ]
    info = observations[0].info
    return (
        *reference_scale.check(tuple(scale for scale in scales if scale), info.depth_unit_m),
        *_check_dots(observations, found, sensor),
        *depth_spread.check(reference for reference in references if reference is not None),
    )


def _refuse_other_camera(item: Observation, first: Observation) -> None:
    own, other = _geometry(item.info), _geometry(first.info)
    if not np.allclose(own, other, rtol=1e-4, atol=1e-2):
        raise refuse(
            f"scene {item.name}",
            f"must be of one camera with scene {first.name}",
            f"size, focal lengths, centre [px] and baseline [mm] {own}, not {other}",
            "Calibrate one camera at a time.",
        )


def _geometry(info: CaptureInfo) -> tuple[float, ...]:
    """Size, intrinsics [px] and baseline [mm]."""
    intrinsics = (info.fx_px, info.fy_px, info.cx_px, info.cy_px)
    return (info.width, info.height, *intrinsics, 1e3 * info.baseline_m)


def _found(item: Observation) -> Correspondences | None:
    if item.left is None or item.right is None:
        return None
    return correspondence.find(item.left, item.right)


def _scale(
    item: Observation, found: Correspondences | None, reference_px: Array | None, sensor: Sensor
) -> Scale | None:
    """Scale by the infrared pair; where there is none, by the device's own depth."""
    if found is not None:
        reference_scale.refuse_swapped(item.name, found)
        return (
            None
            if reference_px is None
            else reference_scale.measure(item.name, found, reference_px, item.info.fx_px)
        )
    if item.depth_m is None or reference_px is None:
        return None
    range_m = (sensor.post.near_m, sensor.post.far_m)
    reference_scale.refuse_out_of_range(item.name, item.depth_m, range_m, item.info.depth_unit_m)
    every = (slice(None, None, _STEP_PX), slice(None, None, _STEP_PX))
    own_px = item.info.disparity_px(item.depth_m)[every].ravel()
    return reference_scale.compare(item.name, own_px, reference_px[every].ravel(), item.info.fx_px)


def _check_dots(
    observations: Sequence[Observation], found: Sequence[Correspondences | None], sensor: Sensor
) -> tuple[str, ...]:
    info = observations[0].info
    seen = {
        item.name: see(places, info)
        for item, places in zip(observations, found, strict=True)
        if places is not None
    }
    if not seen or sensor.projector.power_w == 0:
        return preset_fit.check(info, sensor, None)
    dark = [name for name, dots in seen.items() if dots.share < _DOTTED]
    if len(dark) == len(seen):
        raise refuse(
            "captures",
            "must show the projector's dots",
            f"dots in at most {max(dots.share for dots in seen.values()):.0%} of a scene's windows",
            "Was the emitter off or too weak for the room, or is the pair not rectified? For "
            "captures without it set projector.power_w=0.",
        )
    count = sum(dots.count for dots in seen.values())
    if count < _FEWEST:
        raise refuse(
            "captures",
            f"must show at least {_FEWEST} dots",
            f"about {count:.0f} in {len(seen)} scenes",
            "Capture more scenes, with surfaces all over the image.",
        )
    density = np.concatenate([dots.per_deg2 for name, dots in seen.items() if name not in dark])
    cells = [covered(sensor.projector, dots, info) for dots in seen.values()]
    return (
        *(f"scene {name} shows hardly any dots: was the emitter off?" for name in dark),
        *preset_fit.check(info, sensor, float(density.mean())),
        *_say_coverage(float(np.any(cells, axis=0).mean())),
    )


def _say_coverage(share: float) -> tuple[str, ...]:
    if share >= _COVERED:
        return ()
    return (
        f"dots are seen in {share:.0%} of the projector's field: the pattern beyond stays "
        "unknown, and the projector's rotation and field are weakly held. Fill the image with "
        "surfaces, or capture more scenes.",
    )


def _reference_px(item: Observation) -> Array | None:
    if item.truth_m is not None:
        return truth_px(item)
    return None if item.depth_m is None else item.info.disparity_px(item.depth_m)
