"""Gap reduction by the accepted effects on held-out scenes."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from starling.diagnosis.howfar.distances import scene_distances
from starling.diagnosis.howfar.reduction import GapReduction, gap_reductions
from starling.diagnosis.scenes.observation import SceneObservation
from starling.diagnosis.scenes.request import CAPTURED
from starling.diagnosis.scenes.scene_model import SceneModel
from starling.diagnosis.scenes.shelf import shelve
from starling.diagnosis.which import null
from starling.diagnosis.which.likelihood import Likelihood
from starling.diagnosis.which.null import BaseSamples
from starling.diagnosis.which.response import PredictedChange
from starling.diagnosis.which.segment import SegmentResult
from starling.diagnosis.which.table import FeatureTable
from starling.sim.console import progress
from starling.sim.effects.effect import Value

Settings = Mapping[str, Value]

DRAWS = 4  # Number of seeds simulated per scene.
OTHER = 100  # Device number and seed of the simulated capture that replaces the real one.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Evaluation:
    """Answers to the question how far the gap closes."""

    figures: dict[str, GapReduction]  # With all reported effects together; empty without any.
    alone: dict[str, dict[str, GapReduction]]  # With each accepted effect by itself.
    # Shapley share of each reported effect in the reduction of its segment's features; they sum to
    # 1 in each segment. Empty if some effects can only be applied together.
    shares: dict[str, float]


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class HeldOutSegment:
    """One segment on the held-out scenes."""

    segment: SegmentResult
    table: FeatureTable
    base: BaseSamples
    likelihood: Likelihood  # Of the real gap.

    def select(self, settings: Settings) -> dict[str, Value]:
        """Select the values of effects that the segment accepts."""
        return {name: value for name, value in settings.items() if name in self.segment.settings}


def held_out_segments(
    segments: Sequence[SegmentResult], held_out: Sequence[SceneModel]
) -> list[HeldOutSegment]:
    """Simulate the base of each segment on held-out scenes.

    Args:
        segments: segments with their features.
        held_out: scenes that were not used to select effects, at least one.
    """
    prepared = []
    for segment in segments:
        table = segment.table.with_scenes(held_out)
        base = null.simulate_base(table)
        likelihood = base.likelihood(table.rows(CAPTURED), segment.screening.weight)
        prepared.append(
            HeldOutSegment(segment=segment, table=table, base=base, likelihood=likelihood)
        )
    return prepared


def evaluate_reduction(
    segments: Sequence[HeldOutSegment],
    reported: Settings,
    *,
    track: progress.Progress = progress.silent,
) -> Evaluation:
    """Measure the gap of held-out scenes before and after, and the noise floor.

    Distances compare simulated with real observations, so two compared captures have none.
    In addition, `features of the SEGMENT` is the size of the gap over all features.

    Args:
        segments: segments on the held-out scenes, at least one.
        reported: value by accepted effect that is no surrogate.
        track: wraps loops that take long.
    """
    accepted = {name: value for each in segments for name, value in each.segment.settings.items()}
    trials = [{name: value} for name, value in accepted.items()]
    together = dict(reported)
    if together and together not in trials:
        trials.append(together)
    base = shelve(_draws(scene, {}) for scene in segments[0].table.scene_models)
    measured = {
        tuple(trial): _reductions(segments, base, trial)
        for trial in track(trials, "held-out scenes")
        if all(each.table.change(each.select(trial)) is not None for each in segments)
    }
    shares: dict[str, float] = {}
    for each in segments:
        selected = each.select(reported)
        shares |= _shares(selected, each.table, each.likelihood) if selected else {}
    return Evaluation(
        figures=measured.get(tuple(together), {}),
        alone={name: measured.get((name,), {}) for name in accepted},
        shares=shares,
    )


def _reductions(
    segments: Sequence[HeldOutSegment],
    base: Sequence[Sequence[SceneObservation]],
    settings: Settings,
) -> dict[str, GapReduction]:
    """Measure the gap reduction by some effects; `base` holds draws of each scene without."""
    held_out = segments[0].table.scene_models
    distances = [
        _distances(scene, draws, settings) for scene, draws in zip(held_out, base, strict=True)
    ]
    before, after, floor = ([scene[part] for scene in distances] for part in range(3))
    for each in segments:
        segment = each.segment.table.segment.value
        selected = each.select(settings)
        capture_base, capture = null.simulate_capture(each.table, each.base, selected, number=OTHER)
        simulated = capture_base.likelihood(capture, each.likelihood.weight)
        none = each.likelihood.no_change
        change = _change(each.table, selected) if selected else none
        for rows, likelihood, applied in (
            (before, each.likelihood, none),
            (after, each.likelihood, change),
            (floor, simulated, change),
        ):
            for row, size in zip(rows, likelihood.scene_sizes(applied), strict=True):
                row[f"features of the {segment}"] = float(size)
    return gap_reductions(before, after, floor, [scene.room for scene in held_out])


def _draws(scene: SceneModel, settings: Settings) -> list[SceneObservation]:
    """Simulate a scene with several seeds; nothing if it is compared with another capture."""
    if scene.against is not None:
        return []
    return [scene.observe(scene.request(settings, seed=seed)) for seed in range(DRAWS)]


def _distances(
    scene: SceneModel, base: Sequence[SceneObservation], settings: Settings
) -> tuple[dict[str, float], ...]:
    """Return the distances before, after and at the noise floor for one scene."""
    if scene.against is not None:
        return {}, {}, {}
    after = _draws(scene, settings)
    replacement = scene.observe(scene.request(settings, seed=OTHER, device=OTHER))
    return (
        scene_distances(scene.real, base, scene.strata),
        scene_distances(scene.real, after, scene.strata),
        scene_distances(replacement, after, scene.strata),
    )


def _change(table: FeatureTable, settings: Settings) -> PredictedChange:
    change = table.change(settings)
    assert change is not None  # Accepted effects do not exclude each other.
    return PredictedChange(change)


def _shares(settings: Settings, table: FeatureTable, likelihood: Likelihood) -> dict[str, float]:
    """Return Shapley values of effects over their joint reduction.

    Source: Shapley, A value for n-person games (1953), eq. 13.
    """
    names = tuple(settings)
    reduction: dict[tuple[str, ...], float] = {(): 0.0}
    for count in range(1, len(names) + 1):
        for subset in itertools.combinations(names, count):
            change = table.change({name: settings[name] for name in subset})
            if change is None:  # For example a small SGM penalty above the base's large one.
                return {}
            size = likelihood.size(PredictedChange(change))
            reduction[subset] = likelihood.size(likelihood.no_change) - size
    total = reduction[names]
    if total <= 0:
        return {}
    return {name: _shapley(name, names, reduction) / total for name in names}


def _shapley(
    name: str, names: tuple[str, ...], reduction: Mapping[tuple[str, ...], float]
) -> float:
    remaining = [each for each in names if each != name]
    value = 0.0
    for count in range(len(remaining) + 1):
        weight = math.factorial(count) * math.factorial(len(remaining) - count)
        for subset in itertools.combinations(remaining, count):
            with_it = tuple(each for each in names if each in subset or each == name)
            value += weight * (reduction[with_it] - reduction[subset])
    return value / math.factorial(len(names))
