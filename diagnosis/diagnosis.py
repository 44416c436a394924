"""Diagnosis of one capture set: where the gap lies, which effects explain it, how far it closes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from starling.diagnosis.howfar.evaluation import Evaluation
from starling.diagnosis.howfar.residual import METHOD, LearnedResidual, learn_residual
from starling.diagnosis.report.scene_section import SceneImages, scene_images
from starling.diagnosis.scenes.comparable import split_complete
from starling.diagnosis.scenes.estimated import ABSORBED_FAMILIES
from starling.diagnosis.scenes.limits import list_limits
from starling.diagnosis.scenes.pairs import pair_scenes
from starling.diagnosis.scenes.scene_model import SceneModel, load_scene_model
from starling.diagnosis.validation.adapters.families import refuse_unknown_families
from starling.diagnosis.where.location import GapLocation, locate_gap
from starling.diagnosis.which.attribution import (
    Attribution,
    Kind,
    attribute_effects,
    available_segments,
    screen_segment,
    segment_candidates,
    split_test_rooms,
)
from starling.diagnosis.which.candidates import Segment
from starling.diagnosis.which.discrimination import Discrimination, discriminate
from starling.diagnosis.which.segment import Screening, SegmentResult
from starling.diagnosis.which.sensitivity import DetectionLimit, detection_limits
from starling.diagnosis.which.table import FeatureTable
from starling.diagnosis.workers import WorkerPool
from starling.learning import registry
from starling.learning.method import Method
from starling.patterns.errors import InputError, refuse
from starling.sim.captures.capture import CaptureSet
from starling.sim.console import progress
from starling.sim.effects import setting as setting
from starling.sim.effects.effect import Value
from starling.sim.sensor.sensor import Sensor


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Diagnosis:
    """Result of one diagnosis."""

    kind: Kind
    against: str | None  # Capture set that is compared; None: comparison with simulation.
    scenes: tuple[str, ...]
    held_out: tuple[str, ...]  # Scenes that only measure how far the gap closes.
    fitted: dict[str, dict[str, float]]  # By scene: nuisance parameters fitted to it, by effect.
    limits: tuple[str, ...]  # Limits of these captures, one sentence each.
    where: GapLocation
    segments: tuple[SegmentResult, ...]
    settings: dict[str, Value]  # Value by accepted effect, in all segments.
    compatible: bool  # Whether one sensor can have all accepted effects.
    absorbed: tuple[str, ...]  # Effects that estimates of reflectance and light partly absorb.
    # The best further capture for each accepted effect and its first equivalent candidate.
    discriminations: tuple[Discrimination, ...]
    howfar: Evaluation | None  # None without a held-out scene or an accepted effect.
    residual: LearnedResidual | None  # None if not requested, or if learning was not possible.
    sensitivities: tuple[DetectionLimit, ...]  # Detection limits, if there is no gap.
    example: SceneImages  # Scene shown in the report; a held-out one if there is any.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class _Scenes:
    """Scenes of the captures, split for training and evaluation."""

    complete: list[SceneModel]  # Scenes that hold all that most scenes hold.
    incomplete: list[SceneModel]
    training: list[SceneModel]  # Complete scenes that effects are fitted to.
    held_out: list[SceneModel]  # The other complete scenes.
    unpaired: tuple[str, ...]  # Names of scenes that only one of two capture sets has.


def diagnose(
    captures: CaptureSet,
    sensor: Sensor,
    *,
    against: CaptureSet | None = None,
    cache: Path | None = None,
    families: Sequence[str] | None = None,
    residual: bool = False,
    track: progress.Progress = progress.silent,
) -> Diagnosis:
    """Diagnose the gap between captures and a simulated sensor, or between two capture sets.

    Starts worker processes: in a script, call it below `if __name__ == "__main__"`.

    Args:
        captures: scenes with reference depth or known geometry.
        sensor: the base, a preset or a calibrated sensor with the captures' geometry.
        against: capture set of the same scenes by the base, compared instead of simulations; only
            scenes in both sets count.
        cache: folder that caches simulations of these scenes.
        families: effect families to try; None tries all.
        residual: whether to learn what physics misses (see `howfar.residual`).
        track: wraps long loops to report progress.

    Raises:
        InputError: if a scene is damaged, or has neither known geometry nor reference depth. Also
            if scenes are of several cameras, or two sets differ in geometry or share no scene.
            Also if a family is unknown, or no family acts on what was captured. Also if the sensor
            is not a stereo camera, or `residual` is used with `against` or without torch.
    """
    _refuse_options(sensor, against=against, families=families, residual=residual)
    learner = registry.method(METHOD) if residual else None
    scenes = _load_scenes(captures, sensor, against, track)
    segments = available_segments(scenes.complete, scenes.training)
    untried = _untried_segments(segments, scenes.training, families)
    location = locate_gap(scenes.complete)
    with _worker_pool(captures, sensor, scenes, against) as pool:
        screenings = [
            screen_segment(
                segment, scenes.training, families=families, cache=cache, pool=pool, track=track
            )
            for segment in segments
        ]
        attribution = attribute_effects(screenings, scenes.held_out, track=track)
        discriminations = _propose_captures(attribution.segments, scenes.training, pool, track)
    settings = attribution.settings if attribution.together else {}
    device = (captures if against is None else against).info.sensor
    limits = _limits(device, scenes, attribution, families=families, untried=untried)
    learned, failures = _learn(learner, scenes, settings, track)
    return Diagnosis(
        kind=attribution.kind,
        against=None if against is None else str(against.path),
        scenes=tuple(scene.name for scene in scenes.complete),
        held_out=tuple(scene.name for scene in scenes.held_out),
        fitted=_fitted(scenes.complete),
        limits=(*limits, *failures),
        where=location,
        segments=attribution.segments,
        settings=attribution.settings,
        compatible=attribution.together,
        absorbed=_absorbed(attribution.settings, scenes.complete),
        discriminations=tuple(discriminations),
        howfar=attribution.howfar,
        residual=learned,
        sensitivities=_sensitivities(attribution, screenings),
        example=scene_images((scenes.held_out or scenes.complete)[0], settings),
    )


def _refuse_options(
    sensor: Sensor,
    *,
    against: CaptureSet | None,
    families: Sequence[str] | None,
    residual: bool,
) -> None:
    """Refuse options that exclude each other, unknown families, and sensors without a pair."""
    refuse_unknown_families(families or ())
    if sensor.kind == "structured_light":
        rule = "must be a stereo camera's"
        raise refuse("sensor", rule, sensor.kind, "Structured light has no pair to compare.")
    if residual and against is not None:
        rule = "must be used without another capture set"
        raise refuse("residual", rule, against.path.name, "Leave out residual or against.")


def _load_scenes(
    captures: CaptureSet, sensor: Sensor, against: CaptureSet | None, track: progress.Progress
) -> _Scenes:
    """Load all scenes, set incomplete ones aside, and hold out test rooms."""
    paired = pair_scenes(captures, against)
    loaded = [
        load_scene_model(scene, sensor, against=reference)
        for scene, reference in track(paired.pairs, "scenes")
    ]
    complete, incomplete = split_complete(loaded)
    training, held_out = split_test_rooms(complete)
    return _Scenes(
        complete=complete,
        incomplete=incomplete,
        training=training,
        held_out=held_out,
        unpaired=paired.unpaired,
    )


def _untried_segments(
    segments: Sequence[Segment], training: Sequence[SceneModel], families: Sequence[str] | None
) -> list[Segment]:
    """List segments on which no given family acts; refuse if that holds for all segments."""
    untried = [
        segment for segment in segments if not segment_candidates(segment, training, families)
    ]
    if segments and untried == segments:
        rule = "must have an effect that acts on what these captures hold"
        raise refuse("families", rule, " ".join(families or ()), "Name others, or none.")
    return untried


def _worker_pool(
    captures: CaptureSet, sensor: Sensor, scenes: _Scenes, against: CaptureSet | None
) -> WorkerPool:
    return WorkerPool(
        captures.path,
        sensor,
        scenes.training,
        held_out=scenes.held_out,
        against=None if against is None else against.path,
    )


def _propose_captures(
    segments: Sequence[SegmentResult],
    scenes: Sequence[SceneModel],
    pool: WorkerPool,
    track: progress.Progress,
) -> list[Discrimination]:
    """Find the capture that best separates each accepted effect from its first rival.

    The first capture that separates both reliably is taken; without one, that with the largest
    difference.
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


def _limits(
    device: str,
    scenes: _Scenes,
    attribution: Attribution,
    *,
    families: Sequence[str] | None,
    untried: Sequence[Segment],
) -> list[str]:
    limits = list_limits(
        device,
        scenes.complete,
        held_out=bool(scenes.held_out),
        unpaired=scenes.unpaired,
        incomplete=[scene.name for scene in scenes.incomplete],
        families=families,
        untried=untried,
    )
    if not attribution.together:
        limits.append(
            "The effects accepted for images and for depth exclude each other in one sensor. So "
            "the gap reduction is not evaluated, and no sensor with all of them is written."
        )
    return limits


def _learn(
    learner: Method | None,
    scenes: _Scenes,
    settings: Mapping[str, Value],
    track: progress.Progress,
) -> tuple[LearnedResidual | None, list[str]]:
    """Learn the residual if requested; a failure is reported as a limit and stops nothing else."""
    if learner is None:
        return None, []
    try:
        learned = learn_residual(learner, scenes.training, scenes.held_out, settings, track=track)
    except InputError as error:
        return None, [f"No residual was learned: {error}"]
    return learned, []


def _fitted(scenes: Sequence[SceneModel]) -> dict[str, dict[str, float]]:
    return {
        scene.name: {name: nuisance.value for name, nuisance in scene.nuisances.items()}
        for scene in scenes
    }


def _absorbed(settings: Mapping[str, Value], scenes: Sequence[SceneModel]) -> tuple[str, ...]:
    """List the accepted effects that estimates of reflectance and light partly absorb."""
    if not any(scene.estimates and scene.against is None for scene in scenes):
        return ()
    return tuple(
        name for name in settings if setting.parameter_of(name)[0].family in ABSORBED_FAMILIES
    )


def _sensitivities(
    attribution: Attribution, screenings: Sequence[tuple[FeatureTable, Screening]]
) -> tuple[DetectionLimit, ...]:
    """Return the detection limits of all effects if there is no gap."""
    if attribution.kind != "no gap":
        return ()
    return tuple(limit for _, screening in screenings for limit in detection_limits(screening))
