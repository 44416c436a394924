"""Gap reduction by the accepted effects on held-out scenes."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from starling.diagnosis.howfar.distances import scene_distances
from starling.diagnosis.howfar.evidence import evidence
from starling.diagnosis.howfar.reduction import GapReduction, gap_reductions
from starling.diagnosis.scenes.request import CAPTURED
from starling.diagnosis.scenes.scene_model import SceneModel
from starling.diagnosis.which import null
from starling.diagnosis.which.likelihood import Likelihood
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

    figures: dict[str, GapReduction]
    # Shapley share of each effect in the reduction of its segment's features; they sum to 1 in each
    # segment. Empty if some effects can only be applied together.
    shares: dict[str, float]
    evidence: dict[str, object] = dataclasses.field(default_factory=dict)


def evaluate_reduction(
    held_out: Sequence[SceneModel],
    settings: Settings,
    segments: Sequence[SegmentResult],
    *,
    track: progress.Progress = progress.silent,
) -> Evaluation:
    """Measure the gap of held-out scenes before and after, and the noise floor.

    Distances compare simulated with real observations, so two compared captures have none.
    In addition, `features of the SEGMENT` is the size of the gap over all features.

    Args:
        held_out: scenes that were not used to select effects.
        settings: value by accepted effect.
        segments: segments with their features.
        track: wraps loops that take long.
    """
    distances = [_distances(scene, settings) for scene in track(held_out, "held-out scenes")]
    before, after, floor = ([scene[part] for scene in distances] for part in range(3))
    shares: dict[str, float] = {}
    proofs: dict[str, object] = {}
    for segment in segments:
        table, real, simulated = _likelihoods(segment, held_out)
        change = _change(table, segment.settings) if segment.settings else real.no_change
        name = f"features of the {segment.table.segment.value}"
        for rows, likelihood, applied in (
            (before, real, real.no_change),
            (after, real, change),
            (floor, simulated, change),
        ):
            for row, size in zip(rows, likelihood.scene_sizes(applied), strict=True):
                row[name] = float(size)
        shares |= _shares(segment, table, real)
        trained = segment.table
        for name, each in evidence(segment, table, real).items():
            proofs[name] = {"test": dataclasses.asdict(each)}
        for name, each in evidence(segment, trained, segment.likelihood).items():
            proofs[name]["train"] = dataclasses.asdict(each)
    return Evaluation(
        figures=gap_reductions(before, after, floor, [scene.room for scene in held_out]),
        shares=shares,
        evidence=proofs,
    )


def _distances(scene: SceneModel, settings: Settings) -> tuple[dict[str, float], ...]:
    """Return the distances before, after and at the noise floor for one scene."""
    if scene.against is not None:
        return {}, {}, {}
    before, after = (
        [scene.observe(scene.request(values, seed=seed)) for seed in range(DRAWS)]
        for values in ({}, settings)
    )
    replacement = scene.observe(scene.request(settings, seed=OTHER, device=OTHER))
    return (
        scene_distances(scene.real, before, scene.strata),
        scene_distances(scene.real, after, scene.strata),
        scene_distances(replacement, after, scene.strata),
    )


def _likelihoods(
    segment: SegmentResult, held_out: Sequence[SceneModel]
) -> tuple[FeatureTable, Likelihood, Likelihood]:
    """Return the feature table, and likelihoods of real and of simulated captures."""
    table = segment.table.with_scenes(held_out)
    base, weight = null.simulate_base(table), segment.screening.weight
    capture_base, simulated = null.simulate_capture(table, base, segment.settings, number=OTHER)
    real = base.likelihood(table.rows(CAPTURED), weight)
    return table, real, capture_base.likelihood(simulated, weight)


def _change(table: FeatureTable, settings: Settings) -> PredictedChange:
    change = table.change(settings)
    assert change is not None  # Accepted effects do not exclude each other.
    return PredictedChange(change)


def _shares(
    segment: SegmentResult, table: FeatureTable, likelihood: Likelihood
) -> dict[str, float]:
    """Return Shapley values of the accepted effects over their joint reduction.

    Source: Shapley, A value for n-person games (1953), eq. 13.
    """
    names = tuple(segment.settings)
    reduction: dict[tuple[str, ...], float] = {(): 0.0}
    for count in range(1, len(names) + 1):
        for subset in itertools.combinations(names, count):
            change = table.change({name: segment.settings[name] for name in subset})
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
