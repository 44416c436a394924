"""Fit a sensor to captures. Only a recovered pattern is written to disk."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from starling.calibration import MOST_SCENES, observation, parameters
from starling.calibration.heldout import SMOOTHING_PX, SceneScore, score
from starling.calibration.observation import Observation
from starling.calibration.pattern import pattern_sensor, pattern_solution, recovery
from starling.calibration.pattern.recovery import RecoveredPattern
from starling.calibration.pattern.views import PatternView, make_views
from starling.calibration.plausibility import checks
from starling.calibration.solution import Estimate, Solution
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
WITH_PATTERN = ("baseline", "alignment", "projector", "scale")  # Free in the pattern fit as well.
_ONE_IN = 4  # Default: every fourth room is held out.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Calibration:
    """Result of `calibration.fit`."""

    sensor: Sensor  # The calibrated sensor.
    solutions: Mapping[str, Solution]  # By fit: geometry, pattern ...
    warnings: tuple[str, ...]  # From the plausibility checks of the captures.
    fitted_rooms: tuple[str, ...]
    seconds: Mapping[str, float]  # Wall time by stage [s].
    heldout: tuple[SceneScore, ...] = ()  # Held-out scenes, simulated with the fitted sensor.
    before: tuple[SceneScore, ...] = ()  # The same scenes, simulated with the initial sensor.
    recovered: RecoveredPattern | None = None  # The pattern, if the fit freed it.

    @property
    def estimates(self) -> tuple[Estimate, ...]:
        """All fitted parameters, including those of single scenes."""
        return tuple(
            estimate for solution in self.solutions.values() for estimate in solution.estimates
        )

    @property
    def undetermined(self) -> tuple[str, ...]:
        """Unidentifiable parameters, one sentence each."""
        return tuple(text for solution in self.solutions.values() for text in solution.undetermined)


@contextmanager
def _timed(seconds: dict[str, float], stage: str) -> Iterator[None]:
    start_s = time.perf_counter()
    yield
    seconds[stage] = round(time.perf_counter() - start_s, 2)


def fit(
    scenes: Sequence[CapturedScene],
    sensor: Sensor,
    *,
    free: Sequence[str],
    folder: Path,
    heldout: Sequence[str] | None = None,
    most_scenes: int = MOST_SCENES,
    track: progress.Progress = progress.silent,
) -> Calibration:
    """Fit groups of parameters and score the fit on held-out rooms.

    Three routes calibrate the baseline. The captures and the groups select one:

    - Depth without infrared: the group `baseline` compares the device's disparity with a simulation
      of the reference. It fits f * b and sets `baseline_error` (see `depth.depth_only`).
    - Infrared with the group `pattern`: the pattern fit moves the right image against the pattern.
      It fits f * b and sets `baseline_m` (see `pattern.emission.RightAlignment`). The groups in
      `WITH_PATTERN` are part of it.
    - Infrared without `pattern`: the group `baseline` frees `baseline_m` in the geometry fit of the
      known pattern (see `geometry.geometry_fit`).

    Args:
        scenes: scenes captured by one camera.
        sensor: initial sensor, with the captures' intrinsics. The waves of a unit are dropped: the
            group `warp` measures those of this camera.
        free: names in `GROUPS`; without infrared, in
            `starling.calibration.depth.depth_only.GROUPS`.
        folder: folder for a recovered pattern's images.
        heldout: rooms to exclude from the fit. None selects every fourth room, the third of three
            rooms, and no room of one or two.
        most_scenes: largest number of scenes to fit, and of held-out scenes to score. Of more
            scenes as many are used, spread over the set.
        track: progress callback around long loops.

    Raises:
        InputError: if the captures contradict their metadata, a group or room is unknown, or no
            room remains to fit. Also structured light for a pair.
    """
    from starling.calibration.depth import depth_only

    seconds: dict[str, float] = {}
    _check_groups(free)
    sensor = without_waves(sensor)
    most = errors.whole_number("most_scenes", most_scenes, 1, 10_000)
    outside = _held_out(scenes, heldout)
    all_inside = [scene for scene in scenes if scene.room not in outside]
    inside = _spread(all_inside, most)
    to_score = _spread([scene for scene in scenes if scene.room in outside], most)
    rooms = tuple(dict.fromkeys(scene.room for scene in inside))
    with _timed(seconds, "load"):
        for scene in inside:
            scene.refuse_other_sensor(sensor)
        read_observations = observation.read_all(track(inside, "read"))
        # Checked first, because loading surfaces takes longer.
        warnings = checks.check(read_observations, sensor)
        if len(inside) < len(all_inside):
            advice = "most_scenes changes their number."
            warnings += (f"{len(inside)} of {len(all_inside)} scenes were fitted; {advice}",)
        observations = tuple(
            observation.with_surface(item, scene, sensor, smoothing_px=SMOOTHING_PX)
            for item, scene in zip(read_observations, track(inside, "surfaces"), strict=True)
        )
    if all(item.left is None for item in observations):
        with _timed(seconds, "depth"):
            solution = depth_only.fit_depth(observations, sensor, free=free, track=track)
        return Calibration(
            sensor=solution.sensor,
            solutions={"depth": solution},
            warnings=warnings,
            fitted_rooms=rooms,
            seconds=seconds,
        )
    for group in free:
        if group in depth_only.GROUPS and group not in GROUPS:
            rule = "must be fitted with infrared images"
            advice = f"Captures of depth alone can be fitted by {group}. Leave it out."
            raise errors.refuse("free", rule, group, advice)
    fitted, recovered, solutions = sensor, None, {}
    if PATTERN in free:
        with _timed(seconds, PATTERN):
            recovered = _recovered(observations, sensor, track)
            metric = all(item.metric for item in observations)
            solutions[PATTERN] = pattern_solution.solution(recovered, sensor, metric=metric)
            fitted = pattern_sensor.with_pattern(sensor, recovered, folder)
    geometry = [
        group
        for group in free
        if group in parameters.GEOMETRY and not (PATTERN in free and group in WITH_PATTERN)
    ]
    if geometry:
        from starling.calibration.geometry.geometry_fit import fit_geometry

        with _timed(seconds, "geometry"):
            solutions["geometry"] = fit_geometry(observations, fitted, free=geometry)
            fitted = solutions["geometry"].sensor
    if PHOTOMETRY in free or NOISE in free:
        with _timed(seconds, PHOTOMETRY):
            solutions |= _levels(observations, fitted, recovered, free, track)
            fitted = list(solutions.values())[-1].sensor
    if WARP in free:
        from starling.calibration.geometry.warp_fit import fit_warp

        with _timed(seconds, WARP):
            detailed = [
                observation.with_surface(item, scene, fitted)
                for item, scene in zip(read_observations, track(inside, "warp"), strict=True)
            ]
            solutions[WARP] = fit_warp(detailed, fitted, track=track)
            fitted = solutions[WARP].sensor
    with _timed(seconds, "held out"):
        before, after = _scored(to_score, sensor, fitted, recovered, folder, track)
    return Calibration(
        sensor=fitted,
        solutions=solutions,
        warnings=warnings,
        fitted_rooms=rooms,
        heldout=after,
        before=before,
        recovered=recovered,
        seconds=seconds,
    )


def without_waves(sensor: Sensor) -> Sensor:
    """Return a sensor without the random waves of a unit, which are not those of the camera."""
    sides = {}
    for name, imager in (("left", sensor.left), ("right", sensor.right)):
        still = dataclasses.replace(imager.alignment, waves_px=0.0)
        sides[name] = dataclasses.replace(imager, alignment=still)
    return dataclasses.replace(sensor, **sides)


def _check_groups(free: Sequence[str]) -> None:
    """Refuse an unknown group before the captures are loaded."""
    from starling.calibration.depth import depth_only

    if not free:
        raise errors.refuse("free", "must name a group", "none", f"There are: {', '.join(GROUPS)}.")
    for group in free:
        if group not in depth_only.GROUPS:
            errors.one_of("free", group, GROUPS)


def _recovered(
    observations: Sequence[Observation], sensor: Sensor, track: progress.Progress
) -> RecoveredPattern:
    """Recover the pattern, then repeat with the images aligned by the first estimate."""

    def views(aligned: Sensor) -> list[PatternView]:
        items = track(observations, "views")
        return [view for item in items for view in make_views(item, aligned)]

    recovered = recovery.recover(views(sensor), sensor, track=track)
    aligned = pattern_sensor.with_alignment(sensor, recovered.model)
    return recovery.refine(recovered, views(aligned), aligned)


def _held_out(scenes: Sequence[CapturedScene], requested: Sequence[str] | None) -> tuple[str, ...]:
    rooms = tuple(dict.fromkeys(scene.room for scene in scenes))
    if requested is None:
        return rooms[_ONE_IN - 1 :: _ONE_IN] or rooms[2:]
    for room in requested:
        errors.one_of("heldout", room, rooms)
    if set(requested) == set(rooms):
        raise errors.refuse(
            "heldout", "must leave a room to fit", ", ".join(requested), "Name fewer rooms."
        )
    return tuple(requested)


def _spread(scenes: Sequence[CapturedScene], most: int) -> list[CapturedScene]:
    """Select at most `most` scenes, evenly from the list."""
    step = max(len(scenes) / most, 1)
    return [scenes[int(number * step)] for number in range(min(len(scenes), most))]


def _levels(
    observations: Sequence[Observation],
    sensor: Sensor,
    recovered: RecoveredPattern | None,
    free: Sequence[str],
    track: progress.Progress,
) -> dict[str, Solution]:
    """Fit image levels and noise; each scene is rendered with its own pattern scale."""
    from starling.calibration.photometry.noise import fit_noise
    from starling.calibration.photometry.photometry_fit import (
        PARAMETERS,
        fit_exposure_level,
        fit_photometry,
    )

    parameters_to_fit = PARAMETERS if PHOTOMETRY in free else ()
    if parameters_to_fit:  # Held levels come from the initial sensor, and so does the map.
        observations = [_evenly_lit(item) for item in observations]
    layers = _layers(observations, sensor, recovered)
    levels = fit_photometry(
        observations, sensor, layers=layers, free=parameters_to_fit, track=track
    )
    solutions = {PHOTOMETRY: levels.solution} if parameters_to_fit else {}
    fitted = levels.solution.sensor
    exposure = fit_exposure_level(observations, fitted) if parameters_to_fit else None
    if exposure is not None:
        solutions["exposure"], fitted = exposure, exposure.sensor
    if NOISE in free:
        solutions[NOISE] = fit_noise(observations, levels.predictions, fitted)
    return solutions


def _evenly_lit(seen: Observation) -> Observation:
    """Drop the ambient-light map.

    The map was estimated with the initial haze; keeping it would bias haze towards its start.
    """
    if seen.scene is None or all(body.ambient_share is None for body in seen.scene.bodies):
        return seen
    bodies = tuple(dataclasses.replace(body, ambient_share=None) for body in seen.scene.bodies)
    return dataclasses.replace(seen, scene=dataclasses.replace(seen.scene, bodies=bodies))


def _layers(
    observations: Sequence[Observation], sensor: Sensor, recovered: RecoveredPattern | None
) -> Mapping[str, Layers]:
    if recovered is None:
        return {}
    from starling.sim.render import direct

    def layers(item: Observation) -> Layers:
        light = dataclasses.replace(
            sensor.projector, pattern_scale=recovered.model.scales[item.name]
        )
        return direct.layers(item.stage, dataclasses.replace(sensor, projector=light))

    return {item.name: layers(item) for item in observations if item.scene is not None}


def _scored(
    scenes: Sequence[CapturedScene],
    start: Sensor,
    fitted: Sensor,
    recovered: RecoveredPattern | None,
    folder: Path,
    track: progress.Progress,
) -> tuple[tuple[SceneScore, ...], tuple[SceneScore, ...]]:
    """Score the held-out scenes with the initial and with the fitted sensor."""
    before, after = [], []
    control = pattern_sensor.with_mirrored_pattern(fitted, folder) if recovered else None
    for scene in track(scenes, "held out"):
        item = observation.load(scene, start, smoothing_px=SMOOTHING_PX)
        if item.left is None or item.scene is None:
            continue
        scale = fitted.projector.pattern_scale
        if recovered is not None:
            scale = recovery.scene_scale(make_views(item, start), start, recovered.model)
        before.append(score(item, start, scale=start.projector.pattern_scale))
        after.append(score(item, fitted, scale=scale, mirrored=control))
    return tuple(before), tuple(after)
