"""Calibrate from depth and missing depth only, for captures without infrared images."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from starling.calibration.depth import disparity_scale, hole_places, thresholds
from starling.calibration.depth.depth_twin import DepthTwin, render_twin
from starling.calibration.depth.disparity_scale import ROOMS, DisparityScale
from starling.calibration.observation import Observation
from starling.calibration.solution import Estimate, Solution
from starling.patterns import errors
from starling.sim.console import progress
from starling.sim.effects import setting
from starling.sim.sensor.sensor import Sensor

GROUPS = ("baseline", "offset", "noise", "thresholds")

_NEVER = (
    "Focal length and baseline cannot be estimated from depth alone, only their product "
    "(a scale error of the reference has the same effect): capture infrared of a posed mesh.",
    "Projector position, rotation and field of view cannot be estimated from depth alone: "
    "capture infrared.",
    "The pattern cannot be estimated from depth alone: capture infrared.",
    "Gain, ambient light, reflectance and black level cannot be estimated from depth alone, so a "
    "texture threshold is valid only for the assumed brightness: capture infrared.",
    "Blur, falloff and vignetting cannot be estimated from depth alone: capture infrared.",
)
_REMEDY = {
    "laser_speckle": "capture plain walls at several distances",
    "uniqueness": "capture repeating and dim surfaces",
    "texture_threshold": "capture dark and far surfaces",
    "left_right_threshold": "capture objects in front of a far background",
}
_COLUMNS = {"scale": "baseline", "offset": "offset"}  # Group of each column.
_MORE = 3  # Maximum steps after the first; each step renders all scenes once.
_SETTLED = 0.2  # Change of geometry below which steps end [standard deviations].
_ALIKE = (0.8, 1.25)  # Permitted ratio of device to reference disparity.
_BENT_PX = 0.03  # Smooth residual below which no sentence is reported.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class DepthGeometry:
    """Result of `fit_by_simulation`."""

    sensor: Sensor  # With `baseline_error` and the right image's offset set.
    twins: tuple[DepthTwin, ...]  # Rendered with that sensor.
    last: DisparityScale  # Correction of the last step, with its covariance.


def fit_depth(
    observations: Sequence[Observation],
    sensor: Sensor,
    *,
    free: Sequence[str] = GROUPS,
    track: progress.Progress = progress.silent,
) -> Solution:
    """Fit f * b, disparity offset, scatter and matcher thresholds to depth and missing depth.

    Each scene is simulated from its mesh or reference depth. Scale and offset come from a robust
    regression of the difference between device and simulated disparity, which cancels the
    matcher's bias (see `disparity_scale`). Scatter and thresholds come from a search on the
    simulated images (see `thresholds`). Scale and offset are fitted before and after them. The
    sensor keeps the f * b of the captures, with which the device triangulates. The true value is
    stored as `baseline_error`.

    Args:
        observations: scenes with device depth, and reference depth or a posed mesh.
        sensor: initial sensor; it takes size, intrinsics and baseline from the captures.
        free: names in `GROUPS`.
        track: progress callback around the loops over scenes and stages.

    Returns:
        Estimates `focal_baseline` [px m] and the effects `disparity_offset`, `laser_speckle`,
        `uniqueness`, `texture_threshold`, `left_right_threshold`.

        `cost` is the score of
        `hole_places.difference` at the start and after each stage.

        `scenes` has figures of each scene (see `hole_places.figures`) with the suffix `_device`,
        `_before` or `_after`.

    Raises:
        InputError: if a group is unknown, or the captures are missing or from several cameras.
        InputError: if a scene lacks device depth or reference, or their scales differ.
    """
    twins, start = _prepare(observations, sensor, free, track)
    columns = [name for name, group in _COLUMNS.items() if group in free]
    names = (thresholds.SCATTER,) if "noise" in free else ()
    names += thresholds.CHECKS if "thresholds" in free else ()
    fitted, rendered, geometry, tuning = start, tuple(twins), None, None
    if columns:
        geometry = fit_by_simulation(rendered, fitted, columns, track=track)
        fitted, rendered = geometry.sensor, geometry.twins
    if names:
        tuning = thresholds.tune(hole_places.classify(rendered), fitted, names, track=track)
        fitted = tuning.sensor
    if geometry and tuning:
        geometry = fit_by_simulation(rendered, fitted, columns, track=track)
        fitted = geometry.sensor
    return Solution(
        estimates=(
            *(_geometry_estimates(geometry, start, free) if geometry else ()),
            *(_threshold_estimates(tuning, start) if tuning else ()),
        ),
        covariance=np.asarray(
            block_diag(
                *([_geometry_covariance(geometry, start, free)] if geometry else ()),
                *([tuning.covariance] if tuning else ()),
            ),
            np.float64,
        ),
        undetermined=(
            *(_geometry_sentences(geometry) if geometry else ()),
            *(_threshold_sentences(tuning) if tuning else ()),
            *_NEVER,
        ),
        cost=tuning.scores if tuning else (),
        sensor=fitted,
        scenes=hole_places.compare_readings(twins, start, fitted),
    )


def _prepare(
    observations: Sequence[Observation],
    sensor: Sensor,
    free: Sequence[str],
    track: progress.Progress,
) -> tuple[list[DepthTwin], Sensor]:
    """Refuse captures that cannot be fitted; render each scene with the initial sensor."""
    for group in free:
        if group not in GROUPS:
            raise errors.refuse(
                "free",
                f"must be among {', '.join(GROUPS)} without infrared",
                repr(group),
                "Depth alone does not determine it: capture infrared.",
            )
    if not observations or not free:
        name = "captures" if not observations else "free"
        raise errors.refuse(name, "must not be empty", "none", "Name at least one.")
    if sensor.kind == "structured_light":
        raise errors.refuse(
            "sensor.kind",
            "must be stereo without infrared",
            sensor.kind,
            "Structured light has no right image that could be offset: capture infrared.",
        )
    info = observations[0].info
    for observation in observations[1:]:
        if observation.info.geometry_into(sensor) != info.geometry_into(sensor):
            raise errors.refuse(
                f"geometry of {observation.name}",
                f"must be that of {observations[0].name}",
                "another camera's",
                "Calibrate each camera on its own.",
            )
    start = info.geometry_into(sensor)
    twins = [
        render_twin(observation, start, seed=number)
        for number, observation in enumerate(track(observations, "render"))
    ]
    for depth_twin in twins:
        _refuse_scale(depth_twin)
    return twins, start


def _refuse_scale(depth_twin: DepthTwin) -> None:
    ratio = depth_twin.device_px / depth_twin.truth_px
    known = ratio[np.isfinite(ratio)]
    if known.size and not _ALIKE[0] <= np.median(known) <= _ALIKE[1]:
        raise errors.refuse(
            f"depth of {depth_twin.name}",
            "must be the reference's within 25 %",
            f"{1 / np.median(known):.4g} times it",
            "Check the unit of both depths, depth_unit_m, and the preset of the device.",
        )


def fit_by_simulation(
    twins: Sequence[DepthTwin],
    sensor: Sensor,
    free: Sequence[str],
    *,
    track: progress.Progress = progress.silent,
) -> DepthGeometry:
    """Correct scale and offset until simulated and device disparity agree.

    A matcher biases disparity by up to 0.1 px, depending on its fraction, slope and surroundings.
    The simulation of the same scene has the same bias, so the difference has little of it.
    Source of the method (indirect inference): Gourieroux, Monfort and Renault 1993, Journal of
    Applied Econometrics 8.

    Args:
        twins: scenes rendered with the sensor.
        sensor: initial sensor.
        free: `scale`, `offset` or both.
        track: progress callback around the steps.

    Raises:
        InputError: as `disparity_scale.fit`, or if a value leaves the sensor's range.
    """
    geometry = _step(twins, sensor, free)
    for _ in track(range(_MORE), "geometry"):
        change = np.array([geometry.last.scale, geometry.last.offset_px])
        if (np.abs(change) <= _SETTLED * np.sqrt(np.diagonal(geometry.last.covariance))).all():
            break
        geometry = _step(geometry.twins, geometry.sensor, free)
    return geometry


def _step(twins: Sequence[DepthTwin], sensor: Sensor, free: Sequence[str]) -> DepthGeometry:
    correction = disparity_scale.fit(
        [depth_twin.pair_with(depth_twin.reading(sensor)) for depth_twin in twins], free=free
    )
    corrected = setting.on_sensor(
        sensor,
        {
            "baseline_error": sensor.baseline_error + correction.scale,
            "disparity_offset": sensor.right.alignment.offset_x_px - correction.offset_px,
        },
    )
    return DepthGeometry(
        sensor=corrected,
        twins=tuple(depth_twin.rendered(corrected) for depth_twin in twins),
        last=correction,
    )


def _geometry_estimates(
    geometry: DepthGeometry, start: Sensor, free: Sequence[str]
) -> list[Estimate]:
    """Return scale as f * b, and offset as the effect on the right image, d' = d - offset."""
    focal_baseline, sensor = start.focal_baseline_px_m, geometry.sensor
    deviation = np.sqrt(np.diagonal(geometry.last.covariance))
    rows = {
        "baseline": Estimate(
            name="focal_baseline",
            value=focal_baseline * (1 + sensor.baseline_error),
            sd=focal_baseline * float(deviation[0]),
            unit="px m",
            start=focal_baseline * (1 + start.baseline_error),
        ),
        "offset": Estimate(
            name="disparity_offset",
            value=sensor.right.alignment.offset_x_px,
            sd=float(deviation[1]),
            unit="px",
            start=start.right.alignment.offset_x_px,
        ),
    }
    return [row for group, row in rows.items() if group in free]


def _geometry_covariance(
    geometry: DepthGeometry, start: Sensor, free: Sequence[str]
) -> NDArray[np.float64]:
    """Return the covariance of `_geometry_estimates`, in their units."""
    unit = np.array([start.focal_baseline_px_m, -1.0])
    indices = [index for index, group in enumerate(_COLUMNS.values()) if group in free]
    return (geometry.last.covariance * np.outer(unit, unit))[np.ix_(indices, indices)]


def _geometry_sentences(geometry: DepthGeometry) -> list[str]:
    texts, correction = [], geometry.last
    if not correction.separable:
        texts.append(
            "Baseline x focal length and disparity offset cannot be separated, because all "
            "surfaces lie at about one distance: capture a wall at a second distance."
        )
    rooms = len({depth_twin.room for depth_twin in geometry.twins})
    if rooms < ROOMS:
        texts.append(
            "The uncertainty of f b and offset does not include the scatter between rooms "
            f"(captured: {rooms}): capture {ROOMS} rooms."
        )
    if correction.bend_px > max(_BENT_PX, 3 * correction.bend_sd_px):
        texts.append(
            f"Disparity has a smooth error of {correction.bend_px:.2f} +- "
            f"{correction.bend_sd_px:.2f} px RMS over the image, as from a lens or a rotated "
            "imager, which is not fitted from depth alone: capture infrared."
        )
    return texts


def _threshold_estimates(tuned: thresholds.Tuning, start: Sensor) -> list[Estimate]:
    deviation = np.sqrt(np.diagonal(tuned.covariance))
    rows = []
    for name, value, sd in zip(tuned.names, tuned.values, deviation, strict=True):
        parameter = setting.parameter_of(name)[1]
        initial = setting.value(parameter, start)
        rows.append(
            Estimate(
                name=name,
                value=float(value),
                sd=float(sd),
                unit=parameter.unit,
                start=float(initial) if initial is not None else float("nan"),
            )
        )
    return rows


def _threshold_sentences(tuned: thresholds.Tuning) -> list[str]:
    blind = np.isinf(np.diagonal(tuned.covariance))
    return [
        f"{name} changes missing depth and scatter of these captures too little to be estimated: "
        f"{_REMEDY[name]}."
        for name, is_blind in zip(tuned.names, blind, strict=True)
        if is_blind
    ]
