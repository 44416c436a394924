"""Calibration from depth and holes alone, where captures have no infrared."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from starling.calibration.depth import depth_geometry, hole_places, thresholds
from starling.calibration.depth.depth_figures import Figures, side_by_side
from starling.calibration.depth.depth_geometry import DepthGeometry
from starling.calibration.depth.depth_twin import DepthTwin, twin
from starling.calibration.depth.disparity_scale import ROOMS
from starling.calibration.observation import Observation
from starling.calibration.solution import Estimate, Solution
from starling.patterns import errors
from starling.sim.console import progress
from starling.sim.effects import setting as setting
from starling.sim.sensor.sensor import Sensor

GROUPS = ("baseline", "offset", "noise", "thresholds")

_NEVER = (
    "Focal length and baseline cannot be told from depth alone, only their product "
    "(an error of the reference's scale looks the same): capture infrared of a posed mesh.",
    "Projector position, rotation and field of view cannot be told from depth alone: "
    "capture infrared.",
    "The pattern cannot be told from depth alone: capture infrared.",
    "Gain, ambient light, reflectance and black level cannot be told from depth alone, so a "
    "texture threshold holds for the brightness assumed: capture infrared.",
    "Blur, falloff and vignetting cannot be told from depth alone: capture infrared.",
)
_REMEDY = {
    "laser_speckle": "capture plain walls at several distances",
    "uniqueness": "capture repeating and dim surfaces",
    "texture_threshold": "capture dark and far surfaces",
    "left_right_threshold": "capture things before a far background",
}
_COLUMNS = {"scale": "baseline", "offset": "offset"}  # Group of each.
_ALIKE = (0.8, 1.25)  # Device's disparity over the reference's: beyond, something is wrong.
_BENT_PX = 0.03  # A smooth residual below is nothing to speak of.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class _Fit:
    """What twins tell of a sensor."""

    estimates: tuple[Estimate, ...]
    covariance: NDArray[np.float64]
    undetermined: tuple[str, ...]
    cost: tuple[float, ...]
    sensor: Sensor


def fit_depth(
    observations: Sequence[Observation],
    sensor: Sensor,
    *,
    free: Sequence[str] = GROUPS,
    track: progress.Progress = progress.silent,
) -> Solution:
    """Fit what depth and its holes tell: f b, disparity offset, scatter and thresholds.

    Each scene is simulated from its mesh or reference depth. Scale and offset come from robust
    regression of the device's disparity less the simulated one, so that what the matcher itself
    adds cancels (see `disparity_scale`); scatter and thresholds from trials on the simulated
    images (see `thresholds`). The sensor keeps the f b that the captures name, by which a device
    triangulates: the true one goes to `baseline_error`, as the table of effects has it.

    Args:
        observations: with device depth, and reference depth or a posed mesh.
        sensor: to start from; it takes the captures' size, intrinsics and baseline.
        free: of `GROUPS`, what is fitted.
        track: wraps the loops over scenes and stages.

    Returns:
        Estimates `focal_baseline` [px m], and by the table of effects `disparity_offset`,
        `laser_speckle`, `uniqueness`, `texture_threshold`, `left_right_threshold`. `cost` is the
        score of `hole_places.difference` at the start and after each stage. `scenes` has each
        scene's figures (see `depth_figures`), `_device`, `_before` and `_after` the fit.

    Raises:
        InputError: unknown groups, no captures or several cameras', a scene without device depth
            or without reference, or a reference of another scale.
    """
    twins, start = _prepared(observations, sensor, free, track)
    fit = _fit(twins, start, free, track)
    return Solution(
        estimates=fit.estimates,
        covariance=fit.covariance,
        undetermined=fit.undetermined,
        cost=fit.cost,
        sensor=fit.sensor,
        scenes=side_by_side(twins, start, fit.sensor),
    )


def cross_validate(
    observations: Sequence[Observation],
    sensor: Sensor,
    *,
    free: Sequence[str] = GROUPS,
    folds: int = 3,
    track: progress.Progress = progress.silent,
) -> dict[str, Figures]:
    """Score every scene by a fit to the other rooms.

    Args:
        observations: as in `fit_depth`, of two rooms or more.
        sensor: likewise.
        free: likewise.
        folds: groups of rooms that are held out in turn, >= 2.
        track: wraps the loop over folds.

    Returns:
        Each scene's figures as `Solution.scenes` of `fit_depth`, from fits that never saw its room.

    Raises:
        InputError: as `fit_depth`, or fewer than two rooms or folds.
    """
    errors.in_interval("folds", folds, 2, 1000, "Hold out a half at most.")
    rooms = sorted({observation.room for observation in observations})
    if len(rooms) < 2:
        raise errors.refuse(
            "captures", "must be of two rooms", len(rooms), "One is held out, one is fitted."
        )
    twins, start = _prepared(observations, sensor, free, track)
    held: dict[str, Figures] = {}
    for fold in track(range(min(folds, len(rooms))), "cross-validate"):
        out = set(rooms[fold::folds])
        fit = _fit([t for t in twins if t.room not in out], start, free, progress.silent)
        held |= side_by_side([t for t in twins if t.room in out], start, fit.sensor)
    return held


def _prepared(
    observations: Sequence[Observation],
    sensor: Sensor,
    free: Sequence[str],
    track: progress.Progress,
) -> tuple[list[DepthTwin], Sensor]:
    """Refuse what cannot be fitted, and render each scene as the start sees it."""
    for group in free:
        if group not in GROUPS:
            raise errors.refuse(
                "free",
                f"must be among {', '.join(GROUPS)} without infrared",
                repr(group),
                "Depth alone does not tell it: capture infrared.",
            )
    if not observations or not free:
        what = "captures" if not observations else "free"
        raise errors.refuse(what, "must not be empty", "none", "Name at least one.")
    if sensor.kind == "structured_light":
        raise errors.refuse(
            "sensor.kind",
            "must be stereo without infrared",
            sensor.kind,
            "Structured light has no right image that could be offset: capture infrared.",
        )
    info = observations[0].info
    for other in observations[1:]:
        if other.info.geometry_into(sensor) != info.geometry_into(sensor):
            raise errors.refuse(
                f"geometry of {other.name}",
                f"must be that of {observations[0].name}",
                "another camera's",
                "Calibrate each camera on its own.",
            )
    start = info.geometry_into(sensor)
    twins = [
        twin(observation, start, seed=number)
        for number, observation in enumerate(track(observations, "render"))
    ]
    for one in twins:
        _refuse_scale(one)
    return twins, start


def _refuse_scale(one: DepthTwin) -> None:
    ratio = one.device_px / one.truth_px
    known = ratio[np.isfinite(ratio)]
    if known.size and not _ALIKE[0] <= np.median(known) <= _ALIKE[1]:
        raise errors.refuse(
            f"depth of {one.name}",
            "must be the reference's within 25 %",
            f"{1 / np.median(known):.4g} times it",
            "Is one in millimetres, is depth_unit_m wrong, or the device's preset another?",
        )


def _fit(
    twins: Sequence[DepthTwin], start: Sensor, free: Sequence[str], track: progress.Progress
) -> _Fit:
    """Fit geometry, then holes and scatter by it, then geometry once more by those."""
    moved = [name for name, group in _COLUMNS.items() if group in free]
    names = (thresholds.SCATTER,) if "noise" in free else ()
    names += thresholds.CHECKS if "thresholds" in free else ()
    sensor, geometry, tuned = start, None, None
    if moved:
        geometry = depth_geometry.settle(twins, sensor, moved, track=track)
        sensor, twins = geometry.sensor, geometry.twins
    if names:
        tuned = thresholds.tune(hole_places.compared(twins), sensor, names, track=track)
        sensor = tuned.sensor
    if geometry and tuned:
        geometry = depth_geometry.settle(twins, sensor, moved, track=track)
        sensor = geometry.sensor
    return _Fit(
        estimates=(
            *(_placed(geometry, start, free) if geometry else ()),
            *(_tuned(tuned, start) if tuned else ()),
        ),
        covariance=np.asarray(
            block_diag(
                *([_scaled(geometry, start, free)] if geometry else ()),
                *([tuned.covariance] if tuned else ()),
            ),
            np.float64,
        ),
        undetermined=(
            *(_geometry_said(geometry) if geometry else ()),
            *(_untold(tuned) if tuned else ()),
            *_NEVER,
        ),
        cost=tuned.scores if tuned else (),
        sensor=sensor,
    )


def _placed(geometry: DepthGeometry, start: Sensor, free: Sequence[str]) -> list[Estimate]:
    """Scale as f b, offset as the table of effects has it: of the right image, d' = d - offset."""
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


def _scaled(geometry: DepthGeometry, start: Sensor, free: Sequence[str]) -> NDArray[np.float64]:
    """Covariance of the estimates of `_placed`, in their units."""
    unit = np.array([start.focal_baseline_px_m, -1.0])
    at = [index for index, group in enumerate(_COLUMNS.values()) if group in free]
    return (geometry.last.covariance * np.outer(unit, unit))[np.ix_(at, at)]


def _geometry_said(geometry: DepthGeometry) -> list[str]:
    said, found = [], geometry.last
    if not found.told_apart:
        said.append(
            "Baseline x focal length and disparity offset cannot be told apart, for all surfaces "
            "lie at about one distance: capture a wall at a second distance."
        )
    rooms = len({one.room for one in geometry.twins})
    if rooms < ROOMS:
        said.append(
            f"How far rooms differ, as references are placed, is not in the uncertainty of f b and "
            f"offset from {rooms}: capture {ROOMS} rooms."
        )
    if found.bend_px > max(_BENT_PX, 3 * found.bend_sd_px):
        said.append(
            f"Disparity is off by {found.bend_px:.2f} +- {found.bend_sd_px:.2f} px RMS in a smooth "
            "shape over the image, of a lens or a turned imager, which is not fitted from depth "
            "alone: capture infrared."
        )
    return said


def _tuned(tuned: thresholds.Tuning, start: Sensor) -> list[Estimate]:
    deviation = np.sqrt(np.diagonal(tuned.covariance))
    rows = []
    for name, value, sd in zip(tuned.names, tuned.values, deviation, strict=True):
        parameter = setting.parameter_of(name)[1]
        began = setting.value(parameter, start)
        rows.append(
            Estimate(
                name=name,
                value=float(value),
                sd=float(sd),
                unit=parameter.unit,
                start=float(began) if began is not None else float("nan"),
            )
        )
    return rows


def _untold(tuned: thresholds.Tuning) -> list[str]:
    blind = np.isinf(np.diagonal(tuned.covariance))
    return [
        f"{name} moves neither holes nor scatter of these captures enough to be told: "
        f"{_REMEDY[name]}."
        for name, none in zip(tuned.names, blind, strict=True)
        if none
    ]
