"""Evidence for each accepted effect, and the reasons for which an effect is a surrogate.

A surrogate reduces the gap in the place of another cause. A remaining gap is a reason only
where the scenes cannot account for it. A correct effect on an imperfect base also leaves a
remainder.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from starling.diagnosis.which.likelihood import Likelihood, clipped_squares
from starling.diagnosis.which.residuals import by_group
from starling.diagnosis.which.response import PredictedChange
from starling.diagnosis.which.search import EQUAL_COST, AcceptedEffect
from starling.diagnosis.which.segment import SegmentResult
from starling.diagnosis.which.table import FeatureTable, Row, Rows
from starling.sim.arrays import mean_known

SurrogateReason = Literal["rival", "range", "held out", "misfit", "another make", "remainder"]

_LEAST_EXPLAINED = 0.45  # Least share of the gap that an effect explains in its own features.
_TINY = 1e-9  # Least denominator.


@dataclass(frozen=True, kw_only=True, slots=True)
class EffectEvidence:
    """What an effect does on scenes that did not select it, given the other effects."""

    gain: float  # Gain in log-likelihood.
    explained: float  # Share of the gap that disappears in the features that it changes.
    improved: float  # Decrease in the size of the gap, summed over feature groups that improve.
    worsened: float  # Increase, summed over feature groups that worsen.
    reasons: tuple[SurrogateReason, ...]  # Empty for an effect that is no surrogate.


def weigh_effects(
    segment: SegmentResult, table: FeatureTable, likelihood: Likelihood
) -> dict[str, EffectEvidence]:
    """Weigh the evidence for each accepted effect of a segment.

    Args:
        segment: segment with its accepted effects.
        table: feature table of held-out scenes, or of the training scenes if none is held out.
        likelihood: likelihood of the gap of these scenes.
    """
    scatter = scene_scatter(segment.search.residual)
    return {
        effect.fit.name: _weigh(effect, segment, table, likelihood, scatter)
        for effect in segment.search.accepted
    }


def _weigh(
    effect: AcceptedEffect,
    segment: SegmentResult,
    table: FeatureTable,
    likelihood: Likelihood,
    scatter: Row,
) -> EffectEvidence:
    settings = segment.settings
    rest = {name: value for name, value in settings.items() if name != effect.fit.name}
    after, before = table.change(settings), table.change(rest)
    assert after is not None  # The search accepts only effects that the sensor can have.
    before = np.zeros_like(after) if before is None else before
    changes = [PredictedChange(before), PredictedChange(after)]
    costs = [likelihood.cost(change).sum() for change in changes]
    residuals = [likelihood.residual(change) for change in changes]
    response = (after - before) / (likelihood.deviation * np.sqrt(1 + scatter))
    explained = explained_share(response, residuals[0], residuals[1], likelihood.weight)
    groups = [by_group(table.names, residual, likelihood.weight) for residual in residuals]
    steps = np.array([groups[1][name] - size for name, size in groups[0].items()])
    gain = float(costs[0] - costs[1])
    improved, worsened = float(-steps[steps < 0].sum()), float(steps[steps > 0].sum())
    reasons: list[SurrogateReason] = []
    if any(rival.total > effect.fit.total + EQUAL_COST for rival in effect.rivals):
        reasons.append("rival")
    if effect.at_end:
        reasons.append("range")
    if gain <= 0:
        reasons.append("held out")
    if explained < _LEAST_EXPLAINED:
        reasons.append("misfit")
    if effect.fit.name in segment.like_another_make:
        reasons.append("another make")
    if segment.beyond_scenes:
        reasons.append("remainder")
    return EffectEvidence(
        gain=gain,
        explained=explained,
        improved=improved,
        worsened=worsened,
        reasons=tuple(reasons),
    )


def scene_scatter(residual: Rows) -> Row:
    """Estimate how much of the remaining gap differs between scenes.

    An imperfect base lacks something else in each scene. An effect has one strength in all scenes.

    Args:
        residual: (scenes, features) remaining gap over its deviation; NaN where unknown.

    Returns:
        Variance (features,) between scenes beyond the expected 1; 0 with one scene.
    """
    known = np.isfinite(residual)
    around = np.where(known, residual - mean_known(residual, axis=0), 0.0)
    variance = (around**2).sum(axis=0) / np.maximum(known.sum(axis=0) - 1, 1)
    return np.maximum(variance - 1, 0.0)


def explained_share(
    response: Rows, before: Rows, after: Rows, weight: NDArray[np.float64]
) -> float:
    """Compute how much of the gap disappears in the features that an effect changes.

    Each feature has the relative decrease of its squared deviation, -1 to 1. Features count by the
    square of their change. What other effects leave elsewhere has no weight.

    Args:
        response: (scenes, features) change by the effect over the deviation, scatter included.
        before: (scenes, features) gap without the effect over the deviation; NaN where unknown.
        after: the same with the effect.
        weight: (features,) feature weights.

    Returns:
        1 if nothing is left, 0 if nothing changes, below 0 if the gap grows.
    """
    known = np.isfinite(before)
    moved = weight * clipped_squares(np.where(known, response, 0.0))
    old, new = (np.where(known, gap, 0.0) ** 2 for gap in (before, after))
    decrease = (old - new) / np.maximum(np.maximum(old, new), _TINY)
    return float((moved * decrease).sum() / max(float(moved.sum()), _TINY))
