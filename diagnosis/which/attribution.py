"""Attribution of a gap to effects, by pipeline segment, and its evaluation on held-out rooms."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from starling.diagnosis.howfar.evaluation import (
    Evaluation,
    evaluate_reduction,
    held_out_segments,
)
from starling.diagnosis.howfar.evidence import EffectEvidence, weigh_effects
from starling.diagnosis.scenes import fit_scene
from starling.diagnosis.scenes.estimated import ABSORBED_FAMILIES
from starling.diagnosis.scenes.observation import DepthObservation, StereoObservation
from starling.diagnosis.scenes.scene_model import SceneModel
from starling.diagnosis.scenes.selection import FEWEST_ROOMS
from starling.diagnosis.which.candidates import Candidate, Segment, candidates
from starling.diagnosis.which.segment import (
    Screening,
    SegmentResult,
    diagnose_segment,
    screen_effects,
)
from starling.diagnosis.which.sensitivity import (
    DetectionLimit,
    detection_limits,
    remaining_gap,
)
from starling.diagnosis.which.table import FeatureTable, build_feature_table
from starling.diagnosis.workers import WorkerPool
from starling.patterns.errors import InputError, refuse
from starling.sim.console import progress
from starling.sim.effects import setting as setting
from starling.sim.effects.effect import Value

Kind = Literal["effects", "no gap", "none of the known", "cannot tell"]


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Attribution:
    """Verdict: which effects made the gap, and how far it closes with them."""

    kind: Kind
    segments: tuple[SegmentResult, ...]
    evidence: dict[str, EffectEvidence]  # By accepted effect, in all segments.
    settings: dict[str, Value]  # Value by reported effect: accepted, and no surrogate.
    together: bool  # Whether one sensor can have all reported effects.
    howfar: Evaluation | None  # None without test rooms or accepted effects.

    @property
    def applicable(self) -> dict[str, Value]:
        """Value by reported effect; empty if they exclude each other."""
        return self.settings if self.together else {}

    @property
    def sensitivities(self) -> tuple[DetectionLimit, ...]:
        """Detection limits of the effects that are not accepted, despite the remaining gap.

        Left out are matcher and filters where a gap of the device's depth remains, because a
        matcher of another make may have it.
        """
        limits: list[DetectionLimit] = []
        for segment in self.segments:
            if segment.unexplained and segment.table.segment is Segment.DEPTH:
                continue
            remaining = () if self.kind == "no gap" else (remaining_gap(segment),)
            limits += detection_limits(segment.screening, remaining)
        accepted = self.evidence.keys()
        return tuple(limit for limit in limits if limit.name not in accepted)


def available_segments(
    scene_models: Sequence[SceneModel], training: Sequence[SceneModel]
) -> list[Segment]:
    """List the segments that the captures permit; none if there is only one training room.

    Args:
        scene_models: all scenes, because effects are also evaluated on held-out ones.
        training: training scenes.
    """
    if len({scene.room for scene in training}) < FEWEST_ROOMS:
        return []
    return [segment for segment in Segment if _has_data(segment, scene_models)]


def screen_segment(
    segment: Segment,
    training: Sequence[SceneModel],
    *,
    families: Sequence[str] | None = None,
    always: bool = False,
    cache: Path | None = None,
    pool: WorkerPool | None = None,
    track: progress.Progress = progress.silent,
) -> tuple[FeatureTable, Screening]:
    """Simulate all candidates of one segment.

    Args:
        segment: an available segment.
        training: training scenes, at least one.
        families: as `segment_candidates`.
        always: as `screen_effects`.
        cache: folder that keeps simulated features for later runs.
        pool: workers that simulate; None uses this process.
        track: wraps long loops to report progress.
    """
    table = build_feature_table(training, segment, cache=cache, pool=pool)
    tried = segment_candidates(segment, training, families)
    return table, screen_effects(table, tried, always=always, track=track)


def segment_candidates(
    segment: Segment, training: Sequence[SceneModel], families: Sequence[str] | None = None
) -> list[Candidate]:
    """List the candidates of one segment.

    Nuisance parameters that were fitted to the diagnosed captures themselves are left out.

    Args:
        segment: an available segment.
        training: training scenes, at least one.
        families: families of effects to try; None tries all.
    """
    first = training[0]
    base = setting.apply(first.sensor, first.scene, fit_scene.common_settings(first.nuisances))
    fitted = {name for scene in training if scene.against is None for name in scene.nuisances}
    return [
        candidate
        for candidate in candidates(*base, segment)
        if (families is None or candidate.effect.family in families)
        and candidate.name not in fitted
    ]


def untried_segments(
    segments: Sequence[Segment], training: Sequence[SceneModel], families: Sequence[str] | None
) -> list[Segment]:
    """List segments on which no given family acts.

    Args:
        segments: available segments.
        training: training scenes.
        families: as `segment_candidates`.

    Raises:
        InputError: if no family acts on any segment.
    """
    untried = [
        segment for segment in segments if not segment_candidates(segment, training, families)
    ]
    if segments and untried == segments:
        rule = "must have an effect that acts on what these captures hold"
        raise refuse("families", rule, " ".join(families or ()), "Name others, or none.")
    return untried


def attribute_effects(
    screenings: Sequence[tuple[FeatureTable, Screening]],
    held_out: Sequence[SceneModel],
    *,
    track: progress.Progress = progress.silent,
) -> Attribution:
    """Search for effects in each segment, and evaluate them on held-out scenes.

    Args:
        screenings: feature table and screening of each segment.
        held_out: scenes of the test rooms.
        track: wraps long loops to report progress.
    """
    segments = tuple(
        diagnose_segment(table, screening) for table, screening in track(screenings, "search")
    )
    prepared = held_out_segments(segments, held_out) if held_out else []
    evidence: dict[str, EffectEvidence] = {}
    for number, segment in enumerate(segments):
        scenes = prepared[number] if prepared else segment
        evidence |= weigh_effects(segment, scenes.table, scenes.likelihood)
    settings = {
        name: value
        for segment in segments
        for name, value in segment.settings.items()
        if not evidence[name].reasons
    }
    together = not settings or _compatible(segments[0].table.scene_models[0], settings)
    howfar = None
    if prepared and evidence and together:
        howfar = evaluate_reduction(prepared, settings, track=track)
    return Attribution(
        kind=_kind(segments, settings),
        segments=segments,
        evidence=evidence,
        settings=settings,
        together=together,
        howfar=howfar,
    )


def absorbed_effects(
    settings: Mapping[str, Value], scenes: Sequence[SceneModel]
) -> tuple[str, ...]:
    """List the accepted effects that estimates of reflectance and light partly absorb."""
    if not any(scene.estimates and scene.against is None for scene in scenes):
        return ()
    return tuple(
        name for name in settings if setting.parameter_of(name)[0].family in ABSORBED_FAMILIES
    )


def _compatible(scene: SceneModel, settings: dict[str, Value]) -> bool:
    """Whether one sensor can have all settings."""
    try:
        setting.apply(scene.sensor, scene.scene, scene.scene_settings(settings))
    except InputError:
        return False
    return True


def _has_data(segment: Segment, scene_models: Sequence[SceneModel]) -> bool:
    """Whether all scenes hold what a segment compares."""
    paired = all(isinstance(scene.real, StereoObservation) for scene in scene_models)
    measured = all(isinstance(scene.real, DepthObservation) for scene in scene_models)
    return {
        Segment.IMAGE: paired,
        Segment.DEPTH: paired and measured,
        Segment.WHOLE: measured and not paired,
    }[segment]


def _kind(segments: Sequence[SegmentResult], reported: Mapping[str, Value]) -> Kind:
    if not segments:
        return "cannot tell"
    if reported:
        return "effects"
    if any(segment.unexplained or segment.search.accepted for segment in segments):
        return "none of the known"
    return "no gap"
