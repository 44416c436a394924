"""Check captures for errors before a fit."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from starling.calibration.observation import Array, Observation, truth_px
from starling.calibration.plausibility import correspondence, preset_fit, reference_scale
from starling.calibration.plausibility.correspondence import Correspondences
from starling.calibration.plausibility.dots_seen import covered_cells, detect_dots
from starling.calibration.plausibility.reference_scale import ReferenceScale
from starling.patterns.errors import refuse
from starling.sim.captures.info import CaptureInfo
from starling.sim.sensor.sensor import Sensor

_DOTTED = 0.1  # Minimum share of windows with dots; captured rooms have 0.30 and more.
_FEWEST = 100  # Minimum dot count; at 0.1 px each, they determine a pose to 0.01 px.
_COVERED = 0.5  # Covered share of the projector's field below which a warning is given.
_STEP_PX = 8  # Sampling step of depth maps.
_FINE_STEP_PX = 4  # The same for the range of depth.
_SEEN_PX = 0.02  # Systematic model error of an image shift, which does not average out.
_BASELINE = 0.01  # Permitted relative error of the baseline from that shift.
_SIGMAS = 3.29  # Distance of the 5th and 95th percentile of a normal distribution.


def check(observations: Sequence[Observation], sensor: Sensor) -> tuple[str, ...]:
    """Refuse captures that cannot be fitted; warn about captures that determine little.

    The checks, in order, with the module that documents their thresholds:

    - Scenes have the same geometry.
    - Images without the projector are darker than those with it.
    - Left and right image are not swapped or equal (`reference_scale`).
    - Reference depth is of the same scene and unit (`reference_scale`).
    - Enough dots are visible if the projector is on.
    - Dots and geometry match the camera model (`preset_fit`).
    - Dots cover half of the projector's field (`dots_seen`).
    - The captures span several distances (`check_depth_range`).

    A check is skipped if its image is missing. The device's depth replaces a missing reference.
    The checks take about 0.3 s for a scene of 1280x720 on one core.

    Args:
        observations: at least one observation of one camera.
        sensor: sensor to be fitted.

    Returns:
        Warnings of one or two sentences.

    Raises:
        InputError: if a check fails.
    """
    for item in observations:
        _refuse_other_camera(item, observations[0])
        if sensor.projector.power_w > 0:
            _refuse_bright_off(item)
    correspondences = [_find(item) for item in observations]
    references = [_reference_px(item) for item in observations]
    scales = [
        _scale(item, places, reference, sensor)
        for item, places, reference in zip(observations, correspondences, references, strict=True)
    ]
    info = observations[0].info
    return (
        *reference_scale.check(tuple(scale for scale in scales if scale), info.depth_unit_m),
        *_check_dots(observations, correspondences, sensor),
        *check_depth_range(reference for reference in references if reference is not None),
    )


def _refuse_other_camera(item: Observation, first: Observation) -> None:
    geometry, expected = _geometry(item.info), _geometry(first.info)
    if not np.allclose(geometry, expected, rtol=1e-4, atol=1e-2):
        raise refuse(
            f"scene {item.name}",
            f"must come from the same camera as scene {first.name}",
            f"size, focal lengths, centre [px] and baseline [mm] {geometry}, not {expected}",
            "Calibrate one camera at a time.",
        )


def _refuse_bright_off(item: Observation) -> None:
    """Refuse images without the projector that are as bright as those with it."""
    pairs = {"left": (item.left, item.left_off), "right": (item.right, item.right_off)}
    for side, (image, off) in pairs.items():
        if image is not None and off is not None and off.mean() >= image.mean():
            raise refuse(
                f"scene {item.name}",
                f"must be darker in ir_{side}_off.png than in ir_{side}.png",
                f"means of {off.mean():.4g} and {image.mean():.4g} DN",
                "Capture both with one exposure, and ir_off with the emitter off.",
            )


def _geometry(info: CaptureInfo) -> tuple[float, ...]:
    """Return size, intrinsics [px] and baseline [mm]."""
    intrinsics = (info.fx_px, info.fy_px, info.cx_px, info.cy_px)
    return (info.width, info.height, *intrinsics, 1e3 * info.baseline_m)


def _find(item: Observation) -> Correspondences | None:
    if item.left is None or item.right is None:
        return None
    return correspondence.find(item.left, item.right)


def _scale(
    item: Observation,
    correspondences: Correspondences | None,
    reference_px: Array | None,
    sensor: Sensor,
) -> ReferenceScale | None:
    """Measure the reference's scale against the infrared pair, or else the device's depth."""
    if correspondences is not None:
        reference_scale.refuse_swapped(item.name, correspondences)
        return (
            None
            if reference_px is None
            else reference_scale.measure(item.name, correspondences, reference_px, item.info.fx_px)
        )
    if item.depth_m is None or reference_px is None:
        return None
    range_m = (sensor.post.near_m, sensor.post.far_m)
    reference_scale.refuse_out_of_range(item.name, item.depth_m, range_m, item.info.depth_unit_m)
    sparse = (slice(None, None, _STEP_PX), slice(None, None, _STEP_PX))
    device_px = item.info.disparity_px(item.depth_m)[sparse].ravel()
    return reference_scale.compare(
        item.name, device_px, reference_px[sparse].ravel(), item.info.fx_px
    )


def _check_dots(
    observations: Sequence[Observation],
    correspondences: Sequence[Correspondences | None],
    sensor: Sensor,
) -> tuple[str, ...]:
    info = observations[0].info
    dots_by_scene = {
        item.name: detect_dots(places, info)
        for item, places in zip(observations, correspondences, strict=True)
        if places is not None
    }
    if not dots_by_scene or sensor.projector.power_w == 0:
        return preset_fit.check(info, sensor, None)
    dark = [name for name, dots in dots_by_scene.items() if dots.share < _DOTTED]
    if len(dark) == len(dots_by_scene):
        raise refuse(
            "captures",
            "must show the projector's dots",
            f"dots in at most {max(dots.share for dots in dots_by_scene.values()):.0%} of a "
            "scene's windows",
            "Check that the emitter is on and bright enough, and that the pair is rectified. For "
            "captures without emitter set projector.power_w=0.",
        )
    count = sum(dots.count for dots in dots_by_scene.values())
    if count < _FEWEST:
        raise refuse(
            "captures",
            f"must show at least {_FEWEST} dots",
            f"about {count:.0f} in {len(dots_by_scene)} scenes",
            "Capture more scenes, with surfaces that fill the image.",
        )
    density = np.concatenate(
        [dots.per_deg2 for name, dots in dots_by_scene.items() if name not in dark]
    )
    cells = [covered_cells(sensor.projector, dots, info) for dots in dots_by_scene.values()]
    return (
        *(f"scene {name} shows almost no dots; check that the emitter was on." for name in dark),
        *preset_fit.check(info, sensor, float(density.mean())),
        *_coverage_warning(float(np.any(cells, axis=0).mean())),
    )


def _coverage_warning(share: float) -> tuple[str, ...]:
    if share >= _COVERED:
        return ()
    return (
        f"dots cover {share:.0%} of the projector's field: the pattern outside stays unknown, and "
        "the projector's rotation and field are poorly determined. Fill the image with surfaces, "
        "or capture more scenes.",
    )


def _reference_px(item: Observation) -> Array | None:
    if item.truth_m is not None:
        return truth_px(item)
    return None if item.depth_m is None else item.info.disparity_px(item.depth_m)


def check_depth_range(references_px: Iterable[NDArray]) -> tuple[str, ...]:
    """Warn if the captures show a single distance.

    A relative baseline error e shifts the right image by e d, and yaw of an imager shifts it by
    about a constant. The projector's position and rotation shift its pattern in the same way.
    Only the variation of the disparity d = f b / z separates these parameters. A systematic error
    of 0.02 px gives a relative baseline error of 0.02 px / std(d). The limit is 1 %,
    at a std(d) of 2 px. Here std(d) is the range from the 5th to the 95th percentile of all
    scenes, divided by 3.29. A single captured room has 5 to 26 px.

    Args:
        references_px: (h, w) disparity of each scene [px], NaN where unknown.

    Returns:
        One warning or none.
    """
    sparse = [reference[::_FINE_STEP_PX, ::_FINE_STEP_PX].ravel() for reference in references_px]
    disparity = np.concatenate([d[np.isfinite(d)] for d in sparse]) if sparse else np.empty(0)
    if disparity.size == 0:
        return ()
    low, middle, high = np.percentile(disparity, (5, 50, 95))
    spread = float(high - low) / _SIGMAS
    if spread >= _SEEN_PX / _BASELINE:
        return ()
    return (
        f"the captures show one distance only: disparities around {middle:.1f} px vary by "
        f"{spread:.2g} px. These parameters cannot be separated: baseline and yaw of the imagers; "
        "position, rotation and field of the projector; focal length and distance. Capture a wall "
        "at a second distance, or a room.",
    )
