"""Fit a sensor to captures: what `starling calibrate` does, without files but the pattern's."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

from starling.calibration import heldout as held
from starling.calibration import observation, parameters
from starling.calibration.heldout import Scored
from starling.calibration.observation import Observation
from starling.calibration.pattern import pattern_sensor, pattern_solution, recovery
from starling.calibration.pattern import views as seeing
from starling.calibration.pattern.recovery import Recovered
from starling.calibration.plausibility import checks
from starling.calibration.result import Calibration
from starling.calibration.solution import Solution
from starling.patterns import errors
from starling.sim.captures.capture import CapturedScene
from starling.sim.console import progress
from starling.sim.render.layers import Layers
from starling.sim.sensor.sensor import Sensor

PATTERN = "pattern"
PHOTOMETRY = "photometry"
NOISE = "noise"
WARP = "warp"
GROUPS = (*parameters.GEOMETRY, PATTERN, PHOTOMETRY, NOISE, WARP)
WITH_PATTERN = ("baseline", "alignment", "projector", "scale")  # What the pattern's fit frees too.
_ONE_IN = 4  # Rooms held out where none are named: every fourth, from the last.


class _Clock:
    """Seconds of each stage."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        begun = time.perf_counter()
        yield
        self.seconds[name] = round(time.perf_counter() - begun, 2)


def fit(
    scenes: Sequence[CapturedScene],
    sensor: Sensor,
    *,
    free: Sequence[str],
    folder: Path,
    heldout: Sequence[str] | None = None,
    track: progress.Progress = progress.silent,
) -> Calibration:
    """Fit what is asked for, and score it on rooms that the fit has not seen.

    Args:
        scenes: captured by one camera.
        sensor: to start from, with the captures' intrinsics.
        free: of `GROUPS`; without infrared, of `starling.calibration.depth.depth_only.GROUPS`.
        folder: where a recovered pattern's images go.
        heldout: rooms left out of the fit; every fourth where None, none of one or two rooms.
        track: wraps loops that take long.

    Raises:
        InputError: captures that cannot be what they claim, unknown groups or rooms, nothing left
            to fit.
    """
    clock = _Clock()
    _check_groups(free)
    outside = _held_out(scenes, heldout)
    inside = [scene for scene in scenes if scene.room not in outside]
    rooms = tuple(dict.fromkeys(scene.room for scene in inside))
    with clock.stage("load"):
        seen = observation.read_all(track(inside, "read"))
        warnings = checks.check(seen, sensor)  # Before the surfaces, which take longer.
        observations = tuple(
            observation.with_surface(one, scene, sensor)
            for one, scene in zip(seen, track(inside, "surfaces"), strict=True)
        )
    if all(one.left is None for one in observations):
        return _from_depth(observations, sensor, free, warnings, rooms, clock, track)
    for group in free:
        errors.one_of("free", group, GROUPS)
    fitted, recovered, solutions = sensor, None, {}
    if PATTERN in free:
        with clock.stage(PATTERN):
            recovered = _recovered(observations, sensor, track)
            metric = all(one.metric for one in observations)
            solutions[PATTERN] = pattern_solution.solution(recovered, sensor, metric=metric)
            fitted = pattern_sensor.with_pattern(sensor, recovered, folder)
    geometry = [
        group
        for group in free
        if group in parameters.GEOMETRY and not (PATTERN in free and group in WITH_PATTERN)
    ]
    if geometry:
        from starling.calibration.geometry.geometry_fit import fit_geometry

        with clock.stage("geometry"):
            solutions["geometry"] = fit_geometry(observations, fitted, free=geometry)
            fitted = solutions["geometry"].sensor
    if PHOTOMETRY in free or NOISE in free:
        with clock.stage(PHOTOMETRY):
            solutions |= _levels(observations, fitted, recovered, free)
            fitted = list(solutions.values())[-1].sensor
    if WARP in free:
        from starling.calibration.geometry.warp_fit import fit_warp

        with clock.stage(WARP):
            smooth = [
                observation.with_surface(one, scene, fitted, smoothing_px=held.SMOOTHING_PX)
                for one, scene in zip(seen, track(inside, "warp"), strict=True)
            ]
            solutions[WARP] = fit_warp(smooth, fitted)
            fitted = solutions[WARP].sensor
    with clock.stage("held out"):
        before, after = _scored(scenes, outside, sensor, fitted, recovered, folder, track)
    return Calibration(
        sensor=fitted,
        solutions=solutions,
        warnings=warnings,
        fitted_rooms=rooms,
        heldout=after,
        before=before,
        recovered=recovered,
        seconds=clock.seconds,
    )


def _check_groups(free: Sequence[str]) -> None:
    """Refuse what no captures have, before they are loaded."""
    from starling.calibration.depth.depth_only import GROUPS as OF_DEPTH

    if not free:
        raise errors.refuse("free", "must name a group", "none", f"There are: {', '.join(GROUPS)}.")
    for group in free:
        if group not in OF_DEPTH:
            errors.one_of("free", group, GROUPS)


def _recovered(
    observations: Sequence[Observation], sensor: Sensor, track: progress.Progress
) -> Recovered:
    """Recover the pattern, and once more as its own alignment has the images."""
    views = [view for one in track(observations, "views") for view in seeing.of(one, sensor)]
    recovered = recovery.recover(views, sensor, track=track)
    aligned = pattern_sensor.aligned(sensor, recovered.model)
    views = [view for one in track(observations, "views") for view in seeing.of(one, aligned)]
    return recovery.again(recovered, views, aligned)


def _held_out(scenes: Sequence[CapturedScene], asked: Sequence[str] | None) -> tuple[str, ...]:
    rooms = tuple(dict.fromkeys(scene.room for scene in scenes))
    if asked is None:
        return rooms[_ONE_IN - 1 :: _ONE_IN] or rooms[2:]
    for room in asked:
        errors.one_of("heldout", room, rooms)
    if set(asked) == set(rooms):
        raise errors.refuse(
            "heldout", "must leave a room to fit", ", ".join(asked), "Name fewer rooms."
        )
    return tuple(asked)


def _from_depth(
    observations: Sequence[Observation],
    sensor: Sensor,
    free: Sequence[str],
    warnings: tuple[str, ...],
    rooms: tuple[str, ...],
    clock: _Clock,
    track: progress.Progress,
) -> Calibration:
    from starling.calibration.depth.depth_only import fit_depth

    with clock.stage("depth"):
        solution = fit_depth(observations, sensor, free=free, track=track)
    return Calibration(
        sensor=solution.sensor,
        solutions={"depth": solution},
        warnings=warnings,
        fitted_rooms=rooms,
        heldout=(),
        before=(),
        recovered=None,
        seconds=clock.seconds,
    )


def _levels(
    observations: Sequence[Observation],
    sensor: Sensor,
    recovered: Recovered | None,
    free: Sequence[str],
) -> dict[str, Solution]:
    """Fit levels and noise, each scene lit at its own pattern scale."""
    from starling.calibration.photometry.exposure_level import fit_exposure_level
    from starling.calibration.photometry.noise import fit_noise
    from starling.calibration.photometry.photometry_fit import PARAMETERS, fit_photometry

    asked = PARAMETERS if PHOTOMETRY in free else ()
    if asked:  # Levels that are held are the start's, as the map is.
        observations = [_evenly_lit(one) for one in observations]
    layers = _layers(observations, sensor, recovered)
    exposures = {one.name: one.exposure for one in observations if one.exposure is not None}
    levels = fit_photometry(observations, sensor, layers=layers, exposures=exposures, free=asked)
    out = {PHOTOMETRY: levels.solution} if asked else {}
    fitted = levels.solution.sensor
    exposure = fit_exposure_level(observations, fitted) if asked else None
    if exposure is not None:
        out["exposure"], fitted = exposure, exposure.sensor
    if NOISE in free:
        out[NOISE] = fit_noise(observations, levels.predictions, fitted)
    return out


def _evenly_lit(one: Observation) -> Observation:
    """Drop the map of ambient light by place.

    It was told by the same dots under the start's haze, which would fit best whatever it is.
    """
    if one.scene is None or all(body.ambient_share is None for body in one.scene.bodies):
        return one
    bodies = tuple(dataclasses.replace(body, ambient_share=None) for body in one.scene.bodies)
    return dataclasses.replace(one, scene=dataclasses.replace(one.scene, bodies=bodies))


def _layers(
    observations: Sequence[Observation], sensor: Sensor, recovered: Recovered | None
) -> Mapping[str, Layers]:
    if recovered is None:
        return {}
    from starling.sim.render import direct

    out = {}
    for one in observations:
        if one.scene is None:
            continue
        scale = recovered.fitted.model.scales[one.name]
        light = dataclasses.replace(sensor.projector, pattern_scale=scale)
        out[one.name] = direct.layers(one.stage, dataclasses.replace(sensor, projector=light))
    return out


def _scored(
    scenes: Sequence[CapturedScene],
    rooms: Sequence[str],
    start: Sensor,
    fitted: Sensor,
    recovered: Recovered | None,
    folder: Path,
    track: progress.Progress,
) -> tuple[tuple[Scored, ...], tuple[Scored, ...]]:
    """Score the held-out scenes by the sensor that the fit began from, and by the fitted one."""
    before, after = [], []
    control = pattern_sensor.mirrored(fitted, folder) if recovered else None
    for scene in track([scene for scene in scenes if scene.room in rooms], "held out"):
        one = observation.load(scene, start, smoothing_px=held.SMOOTHING_PX)
        if one.left is None or one.scene is None:
            continue
        scale = fitted.projector.pattern_scale
        if recovered is not None:
            views = seeing.of(one, start)
            scale = recovery.scene_scale(views, start, recovered.fitted.model)
        before.append(held.score(one, start, scale=start.projector.pattern_scale))
        after.append(held.score(one, fitted, scale=scale, mirrored=control))
    return tuple(before), tuple(after)
