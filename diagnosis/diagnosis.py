"""Diagnosis of one capture set: where the gap lies, which effects explain it, how far it closes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from starling.diagnosis.howfar.evaluation import Evaluation
from starling.diagnosis.howfar.evidence import EffectEvidence
from starling.diagnosis.howfar.remainder import Remainder, remainder
from starling.diagnosis.howfar.residual import METHOD, LearnedResidual, try_residual
from starling.diagnosis.report.first_answer import announcement, first_answer
from starling.diagnosis.report.scene_section import SceneImages, scene_images
from starling.diagnosis.scenes.fit_scene import fitted_values
from starling.diagnosis.scenes.limits import list_limits
from starling.diagnosis.scenes.selection import ignore_scene, load_scenes
from starling.diagnosis.validation.adapters.families import refuse_unknown_families
from starling.diagnosis.where.location import GapLocation, locate_gap
from starling.diagnosis.where.remainder import RemainderPlace, remainder_places
from starling.diagnosis.which.attribution import (
    Kind,
    absorbed_effects,
    attribute_effects,
    available_segments,
    screen_segment,
    untried_segments,
)
from starling.diagnosis.which.discrimination import Discrimination, propose_captures
from starling.diagnosis.which.segment import SegmentResult
from starling.diagnosis.which.sensitivity import DetectionLimit
from starling.diagnosis.workers import WorkerPool
from starling.learning import registry
from starling.patterns.errors import refuse
from starling.sim.captures.capture import CaptureSet
from starling.sim.console import progress
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
    restricted: bool  # Whether only some families of effects were tried.
    where: GapLocation
    segments: tuple[SegmentResult, ...]
    evidence: dict[str, EffectEvidence]  # By accepted effect, in all segments.
    settings: dict[str, Value]  # Value by reported effect: accepted, and no surrogate.
    compatible: bool  # Whether one sensor can have all reported effects.
    remainders: dict[str, Remainder]  # By segment.
    places: dict[str, RemainderPlace]  # By segment with a remainder.
    absorbed: tuple[str, ...]  # Effects that estimates of reflectance and light partly absorb.
    # The best further capture for each accepted effect and its first equivalent candidate.
    discriminations: tuple[Discrimination, ...]
    howfar: Evaluation | None  # None without a held-out scene or an accepted effect.
    residual: LearnedResidual | None  # None if not requested, or if learning was not possible.
    sensitivities: tuple[DetectionLimit, ...]  # Detection limits, despite what remains of a gap.
    example: SceneImages  # Scene shown in the report; a held-out one if there is any.


def diagnose(
    captures: CaptureSet,
    sensor: Sensor,
    *,
    against: CaptureSet | None = None,
    cache: Path | None = None,
    families: Sequence[str] | None = None,
    residual: bool = False,
    track: progress.Progress = progress.silent,
    note: progress.Note | None = None,
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
        note: takes sentences that are known before effects are tried: the coherence split of the
            first scenes, then of all, and the stage ablation.

    Raises:
        InputError: if a scene is damaged, or has neither known geometry nor reference depth. Also
            if scenes are of several cameras, or two sets differ in geometry or share no scene.
            Also if a family is unknown, or no family acts on what was captured. Also if the sensor
            is not a stereo camera, or `residual` is used with `against` or without torch.
    """
    _refuse_options(sensor, against=against, families=families, residual=residual)
    learner = registry.method(METHOD) if residual else None
    reference = None if against is None else str(against.path)
    announce = ignore_scene if note is None else announcement(note, reference)
    scenes = load_scenes(captures, sensor, against, track=track, announce=announce)
    segments = available_segments(scenes.complete, scenes.training)
    untried = untried_segments(segments, scenes.training, families)
    location = locate_gap(scenes.complete)
    if note is not None:
        for sentence in first_answer(location, reference):
            note(sentence)
    reference_path = None if against is None else against.path
    with WorkerPool(
        captures.path, sensor, scenes.training, held_out=scenes.held_out, against=reference_path
    ) as pool:
        screen = partial(screen_segment, families=families, cache=cache, pool=pool, track=track)
        screenings = [screen(segment, scenes.training) for segment in segments]
        attribution = attribute_effects(screenings, scenes.held_out, track=track)
        discriminations = propose_captures(attribution.segments, scenes.training, pool, track)
    settings = attribution.applicable
    learned, failures = try_residual(learner, scenes, settings, track=track)
    remainders = {
        segment.table.segment.value: remainder(
            segment, bool(segment.settings.keys() & attribution.settings.keys()), attribution.howfar
        )
        for segment in attribution.segments
    }
    device = (against or captures).info.sensor
    limits = list_limits(device, scenes, families, untried, compatible=attribution.together)
    return Diagnosis(
        kind=attribution.kind,
        against=reference,
        scenes=tuple(scene.name for scene in scenes.complete),
        held_out=tuple(scene.name for scene in scenes.held_out),
        fitted={scene.name: fitted_values(scene.nuisances) for scene in scenes.complete},
        limits=(*limits, *failures),
        restricted=families is not None,
        where=location,
        segments=attribution.segments,
        evidence=attribution.evidence,
        settings=attribution.settings,
        compatible=attribution.together,
        remainders=remainders,
        places=remainder_places(
            scenes.training, settings, [name for name, left in remainders.items() if left.notable]
        ),
        absorbed=absorbed_effects(attribution.settings, scenes.complete),
        discriminations=tuple(discriminations),
        howfar=attribution.howfar,
        residual=learned,
        sensitivities=attribution.sensitivities,
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
