"""Choice of a further capture that separates two effects which these captures cannot separate.

Both effects are simulated in each capture of a menu. The separation is the difference of the two
simulations in standard deviations.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from starling.diagnosis.scenes import scene_model
from starling.diagnosis.scenes.request import Request, Source
from starling.diagnosis.scenes.scene_model import SceneModel
from starling.diagnosis.which.candidates import Segment
from starling.diagnosis.which.null import FLOOR
from starling.diagnosis.which.residuals import feature_group
from starling.diagnosis.which.segment import SegmentResult
from starling.diagnosis.which.table import BITS, build_feature_table
from starling.diagnosis.workers import WorkerPool
from starling.patterns.errors import InputError
from starling.sim.console import progress
from starling.sim.effects import setting as setting
from starling.sim.effects.effect import Value
from starling.sim.scene.builtin import scenes
from starling.sim.scene.scene import Scene
from starling.sim.sensor.edits import with_values
from starling.sim.sensor.sensor import Sensor

_SEEDS = 4  # Noise seeds of a proposed capture.
_REPEATS = 8  # Frames of a proposed capture of temporal noise.
_MOST = 4.0  # Upper limit of one feature's deviation: one alone must not reach `SEPARATED`.
_FILTERS = {
    "decimation": 1.0,
    "spatial_filter": 1.0,
    "temporal_filter": 1.0,
    "hole_filling": "off",
}
SEPARATED = 5.0  # Root sum of squares over feature groups from which two effects are separated.

Setup = tuple[Scene, Sensor]
FeatureSamples = tuple[Sequence[str], NDArray[np.float64]]  # Feature names, (seeds, features).


@dataclass(frozen=True, kw_only=True, slots=True)
class Proposal:
    """A capture that could be taken."""

    text: str
    cost: float  # Relative effort; 1: flip a switch.
    frames: int
    setups: Callable[[Scene, Sensor], Sequence[Setup]]
    segments: frozenset[Segment] = frozenset(Segment)  # Segments in which it shows anything.


@dataclass(frozen=True, kw_only=True, slots=True)
class Discrimination:
    """How well a capture separates two equivalent candidates."""

    capture: str
    rivals: tuple[str, str]
    deviations: float  # Root sum of squares over feature groups.

    @property
    def enough(self) -> bool:
        """Whether the capture separates them."""
        return self.deviations >= SEPARATED


def _projector_off(scene: Scene, sensor: Sensor) -> Sequence[Setup]:
    return [(scene, with_values(sensor, [("projector.power_w", 0.0)]))]


def _cap_on(scene: Scene, sensor: Sensor) -> Sequence[Setup]:
    dark = dataclasses.replace(
        _with_ambient(scene, 0.0),
        sun=dataclasses.replace(scene.sun, irradiance_w_m2=0.0),
        other_projector=dataclasses.replace(scene.other_projector, power_w=0.0),
    )
    return [(dark, with_values(sensor, [("projector.power_w", 0.0)]))]


def _lamp_on(scene: Scene, sensor: Sensor) -> Sequence[Setup]:
    return [(_with_ambient(scene, 4 * scene.ambient.irradiance_w_m2 + 1.0), sensor)]


def _double_exposure(scene: Scene, sensor: Sensor) -> Sequence[Setup]:
    exposure_s = 2 * sensor.left.exposure_s
    return [(scene, with_values(sensor, [("imager.exposure_s", exposure_s)]))]


def _walls(scene: Scene, sensor: Sensor) -> Sequence[Setup]:
    return [(_at_wall(scene, scenes.wall(z)), sensor) for z in (0.6, 1.2, 2.4)]


def _at_wall(scene: Scene, wall: Scene) -> Scene:
    """Light a wall as the scene, with the same camera motion.

    The scene's reflectance and the error of its reference do not apply to the wall.
    """
    light = dataclasses.replace(scene.ambient, up=wall.ambient.up)
    return dataclasses.replace(
        wall,
        ambient=light,
        sun=scene.sun,
        other_projector=scene.other_projector,
        interreflection=scene.interreflection,
        motion=scene.motion,
    )


def _as_is(scene: Scene, sensor: Sensor) -> Sequence[Setup]:
    return [(scene, sensor)]


def _filters_off(scene: Scene, sensor: Sensor) -> Sequence[Setup]:
    return [(scene, setting.on_sensor(sensor, _FILTERS))]


def _with_ambient(scene: Scene, irradiance_w_m2: float) -> Scene:
    ambient = dataclasses.replace(scene.ambient, irradiance_w_m2=irradiance_w_m2)
    return dataclasses.replace(scene, ambient=ambient)


MENU = (
    Proposal(text="the same scene with the projector off", cost=1, frames=1, setups=_projector_off),
    Proposal(text="a lens cap on", cost=1, frames=_REPEATS, setups=_cap_on),
    Proposal(text="the same scene with a lamp on", cost=1, frames=1, setups=_lamp_on),
    Proposal(
        text="the same scene exposed twice as long", cost=1, frames=1, setups=_double_exposure
    ),
    Proposal(text=f"{_REPEATS} repeats of the same scene", cost=1, frames=_REPEATS, setups=_as_is),
    Proposal(
        text="the same scene with the depth filters off",
        cost=1,
        frames=1,
        setups=_filters_off,
        segments=frozenset({Segment.DEPTH, Segment.WHOLE}),
    ),
    Proposal(text="a flat wall at 0.6, 1.2 and 2.4 m", cost=3, frames=1, setups=_walls),
)


def propose_captures(
    segments: Sequence[SegmentResult],
    scenes: Sequence[SceneModel],
    pool: WorkerPool,
    track: progress.Progress,
) -> list[Discrimination]:
    """Find the capture that best separates each accepted effect from its first rival.

    The first capture that separates both reliably is taken; without one, that with the largest
    difference.

    Args:
        segments: diagnosed segments.
        scenes: training scenes.
        pool: workers that simulate.
        track: wraps the loop over pairs to report progress.
    """
    pairs: list[tuple[Mapping[str, Value], Mapping[str, Value], Segment]] = []
    for segment in segments:
        for effect in segment.search.accepted:
            rest = {
                name: value for name, value in segment.settings.items() if name != effect.fit.name
            }
            pairs += [
                (
                    rest | {effect.fit.name: effect.fit.value},
                    rest | {rival.name: rival.value},
                    segment.table.segment,
                )
                for rival in effect.rivals[:1]
            ]
    # Each pair uses another scene, because the next scene belongs to another worker.
    futures = [
        pool.submit(scenes[number % len(scenes)].name, discriminate, *pair)
        for number, pair in enumerate(pairs)
    ]
    proposals = []
    for future in track(futures, "further captures"):
        options = future.result()
        largest = max(options, key=lambda option: option.deviations, default=None)
        best = next((option for option in options if option.enough), largest)
        proposals += [] if best is None else [best]
    return proposals


def discriminate(
    scene: SceneModel,
    first: Mapping[str, Value],
    second: Mapping[str, Value],
    segment: Segment,
    *,
    menu: Sequence[Proposal] = MENU,
) -> list[Discrimination]:
    """Simulate two equivalent candidates in every capture of a menu.

    Args:
        scene: model of a captured scene.
        first: settings of the first candidate.
        second: settings of the second candidate.
        segment: segment in which they act.
        menu: captures that could be taken.

    Returns:
        The captures with the largest separation for their cost first. Captures in which a candidate
        cannot be simulated are left out.
    """
    names = (" with ".join(first), " with ".join(second))
    ranked = []
    for proposal in menu:
        if segment not in proposal.segments:
            continue
        squares = _squares(first, second, scene, segment, proposal)
        if squares is not None:
            separation = Discrimination(
                capture=proposal.text, rivals=names, deviations=float(np.sqrt(squares))
            )
            ranked.append((separation.deviations / proposal.cost, separation))
    return [separation for _, separation in sorted(ranked, key=lambda pair: -pair[0])]


def _squares(
    first: Mapping[str, Value],
    second: Mapping[str, Value],
    scene: SceneModel,
    segment: Segment,
    proposal: Proposal,
) -> float | None:
    """Sum the squared deviations between two candidates over groups of features."""
    # Output images lack the bits that the device's matcher reads; the feature table adds these.
    rematched = [BITS] if segment is Segment.DEPTH else []
    rivals = (first, second)
    bits = [{k: v for k, v in rival.items() if k in rematched} for rival in rivals]
    rest = [{k: v for k, v in rival.items() if k not in rematched} for rival in rivals]
    all_setups = [_setups(rival, scene, proposal) for rival in rest]
    known_setups = [setups for setups in all_setups if setups is not None]
    if len(known_setups) < len(all_setups):
        return None
    total = 0.0
    for number, setup in enumerate(proposal.setups(scene.scene, scene.sensor)):
        base = _scene_model(scene, setup, proposal, number)
        if segment is Segment.DEPTH:
            both = Request(source=Source.BOTH)
            base = dataclasses.replace(base, real=base.observe(both))
        samples = []
        for setups, extra_bits in zip(known_setups, bits, strict=True):
            # Both candidates are compared in the bins of the base.
            model = _scene_model(scene, setups[number], proposal, number)
            model = dataclasses.replace(model, real=base.real, strata=base.strata)
            table = build_feature_table([model], segment)
            seeds = range(1 if segment is Segment.DEPTH else _SEEDS)
            requests = [table.request(extra_bits, seed=seed) for seed in seeds]
            try:
                simulated = [table.rows(request) for request in requests]
            except InputError:
                return None
            samples.append((table.names, np.concatenate(simulated)))
        total += _squared_distance(*samples)
    return total


def _setups(
    rival: Mapping[str, Value], scene: SceneModel, proposal: Proposal
) -> Sequence[Setup] | None:
    """Apply a candidate, then a proposal, to scene and sensor; None if that is not possible.

    The order matters: what a proposal switches off stays off.
    """
    try:
        settings = scene.scene_settings(rival)
        sensor, changed = setting.apply(scene.sensor, scene.scene, settings)
        return proposal.setups(changed, sensor)
    except InputError:
        return None


def _scene_model(scene: SceneModel, setup: Setup, proposal: Proposal, number: int) -> SceneModel:
    """Build the model of a proposed capture."""
    return scene_model.build_scene_model(
        *setup,
        name=f"{scene.name} {number}",
        room=scene.room,
        truth_m=None,
        frames=proposal.frames,
    )


def _squared_distance(first: FeatureSamples, second: FeatureSamples) -> float:
    """Sum the squared deviations between two samples; each group of features counts once."""
    names = sorted({*first[0]} & {*second[0]})
    first_rows, second_rows = (
        rows[:, [columns.index(name) for name in names]] for columns, rows in (first, second)
    )
    sigma = np.full(len(names), FLOOR)
    if len(first_rows) > 1:
        variance = 0.5 * (first_rows.var(axis=0, ddof=1) + second_rows.var(axis=0, ddof=1))
        sigma = np.sqrt(variance + FLOOR**2)
    difference = np.abs(first_rows.mean(axis=0) - second_rows.mean(axis=0))
    deviations = np.minimum(difference / sigma, _MOST)
    groups: dict[str, list[float]] = {}
    for name, deviation in zip(names, deviations, strict=True):
        if np.isfinite(deviation):
            groups.setdefault(feature_group(name), []).append(float(deviation) ** 2)
    return float(sum(np.mean(squares) for squares in groups.values()))
