"""Scores of a diagnosis on cases with known effects, and their goals."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from starling.diagnosis.validation.camera.nominal import Nominal
from starling.diagnosis.validation.protocol import breakdown
from starling.diagnosis.validation.protocol.score_statistic import ScoreStatistic, statistic
from starling.diagnosis.validation.protocol.tier import TIERS
from starling.diagnosis.validation.protocol.verdict import CaseResult


@dataclass(frozen=True, kw_only=True, slots=True)
class Goal:
    """Inclusive bounds of a score."""

    least: float = -math.inf
    most: float = math.inf
    percent: bool = False

    @property
    def bounds(self) -> str:
        """The bounds as text."""
        if math.isinf(self.least):
            return f"<= {self._number(self.most)}"
        if math.isinf(self.most):
            return f">= {self._number(self.least)}"
        return f"{self._number(self.least)} to {self._number(self.most)}"

    def reached(self, value: float | None) -> bool | None:
        """Return whether a score is within the bounds, or None if there is no score."""
        return None if value is None else self.least <= value <= self.most

    def _number(self, value: float) -> str:
        if self.percent:
            return f"{value:.0f} %"
        return str(value) if isinstance(value, int) else f"{value:.2f}"


# Goals with the renderer and matcher of the diagnosis, and with others.
_GOALS = {
    "top1": (Goal(least=0.90), Goal(least=0.75)),
    "baselines_as_good": (Goal(most=0), Goal(most=0)),
    "in_set": (Goal(least=0.97), Goal(least=0.92)),
    "set_size": (Goal(most=1.6), Goal(most=2.5)),
    "parameter_error_pct": (Goal(most=12, percent=True), Goal(most=30, percent=True)),
    "coverage": (Goal(least=0.80, most=0.97), Goal(least=0.80, most=0.97)),
    "false_alarm": (Goal(most=0.05), Goal(most=0.10)),
    "pairs_both": (Goal(least=0.75), Goal(least=0.55)),
    "unknown_recall": (Goal(least=0.85), Goal(least=0.70)),
    "unknown_false": (Goal(most=0.05), Goal(most=0.15)),
    "remainder_recall": (Goal(least=0.85), Goal(least=0.70)),
    "remainder_false": (Goal(most=0.05), Goal(most=0.15)),
    "closed_pct": (Goal(least=85, percent=True), Goal(least=60, percent=True)),
}

# Goals with an imperfect base.
_IMPERFECT = {
    "reported": Goal(least=0.85),
    "reported_wrong": Goal(most=0.10),
    "baselines_as_good": Goal(most=0),
    "false_named": Goal(most=0.05),
    "closed_pct": Goal(least=60, percent=True),
}

# Depth and holes alone do not identify the effect in every case.
_WITHOUT_INFRARED = {
    "answered": Goal(least=0.60),
    "top1_of_answered": Goal(least=0.70),
    "baselines_as_good": Goal(most=0),
    "false_alarm": Goal(most=0.05),
}


def compare_with_goals(
    tier: int, scores: Mapping[str, float | None], *, infrared: bool = True
) -> dict[str, dict[str, Any]]:
    """Compare scores to the goals of a tier.

    Args:
        tier: Tier of the check.
        scores: Scores by name; must hold all scores that have a goal.
        infrared: Whether the captures hold infrared.

    Returns:
        By score, the goal as text and whether it is reached (None without a score).
    """
    goals = _WITHOUT_INFRARED
    if infrared and TIERS[tier].imperfect:
        goals = _IMPERFECT
    elif infrared:
        place = 0 if TIERS[tier].source == "starling" else 1
        goals = {key: pair[place] for key, pair in _GOALS.items()}
    return {
        key: {"asked": goal.bounds, "reached": goal.reached(scores[key])}
        for key, goal in goals.items()
    }


def score(
    results: Sequence[CaseResult],
    nominal: Nominal,
    *,
    tier: int,
    families: Mapping[str, str],
    infrared: bool = True,
    left_out: Sequence[CaseResult] = (),
    family_alone: Sequence[CaseResult] = (),
) -> dict[str, Any]:
    """Score verdicts on cases.

    Args:
        results: Cases of all kinds with their verdicts.
        nominal: Nominal camera of the cases.
        tier: Tier of the check, 1 to 5. The goals depend on it.
        families: Sealed family of each effect of the diagnosis.
        infrared: Whether the captures hold infrared. Without infrared other goals apply.
        left_out: Single-effect cases, diagnosed without the family of the true effect and without
            the families of its confusable effects. The correct answer is an unknown effect.
        family_alone: The same cases, diagnosed without the family of the true effect. A confusable
            effect may then be named.

    Returns:
        The scores by name, as written to JSON. Rates are 0 to 1, None without a relevant case.
        `intervals` are 95 % intervals over scene sets. Real pairs have none, because their sets
        share rooms. `goals` compares the scores to the goals of the tier.
    """
    null, single, pair, unknown = _by_kind(results)
    present = [*single, *pair]
    statistics = {
        **_singles(single, nominal, families),
        "false_alarm": statistic(null, lambda result: result.gap_reported),
        "false_named": statistic(null, lambda result: result.verdict.kind == "effects"),
        "false_wrong": statistic(null, lambda result: result.wrong_named),
        "pairs_both": statistic(pair, lambda result: result.both_in_sets),
        "pairs_both_named": statistic(pair, lambda result: result.all_named),
        "pairs_first": statistic(pair, lambda result: result.top1_correct),
        "unknown_recall": _unknown_share([*unknown, *left_out]),
        "unknown_recall_outside": _unknown_share(unknown),
        "unknown_recall_left_out": _unknown_share(left_out),
        "unknown_recall_family": _unknown_share(family_alone),
        "unknown_false": _unknown_share([*null, *present]),
        "unknown_false_effects": _unknown_share(present),
        "remainder_recall": _remainder_share([*unknown, *left_out]),
        "remainder_false": _remainder_share([*null, *present]),
        "closed_pct": statistic(present, breakdown.closed_pct, median=True),
        "closed_not_identifiable": statistic(
            present,
            lambda result: bool(result.verdict.named) and result.verdict.headline_pct is None,
        ),
    }
    baseline_scores = breakdown.baselines(single)
    scores = {
        **{key: value.value for key, value in statistics.items()},
        "baselines_as_good": breakdown.count_as_good(statistics["top1"].value, baseline_scores),
    }
    compared = compare_with_goals(tier, scores, infrared=infrared)
    shown = {} if TIERS[tier].source == "real" else compared
    return {
        "tier": tier,
        "cases": {
            **{"null": len(null), "single": len(single), "pair": len(pair)},
            "unknown": len(unknown) + len(left_out),
        },
        **scores,
        "by_effect": breakdown.by_effect(single, nominal),
        "by_range": breakdown.by_range(single, nominal),
        "by_imperfection": breakdown.by_imperfection(results),
        "confusion": breakdown.confusion(results, left_out),
        "baselines": baseline_scores,
        "closed_by_metric": breakdown.closed_by_metric(present),
        "seconds": math.fsum(
            result.verdict.seconds for result in (*results, *left_out, *family_alone)
        ),
        "intervals": _intervals(
            {key: statistics[key] for key in shown if key in statistics}, (*results, *left_out)
        ),
        "goals": compared,
        "failures": breakdown.failures(results, left_out),
    }


def _by_kind(results: Sequence[CaseResult]) -> list[list[CaseResult]]:
    """Divide cases into nulls, singles, pairs and unknowns."""
    kinds = ("null", "single", "pair", "unknown")
    return [[result for result in results if result.case.kind == kind] for kind in kinds]


def _singles(
    singles: Sequence[CaseResult], nominal: Nominal, families: Mapping[str, str]
) -> dict[str, ScoreStatistic]:
    named = [result for result in singles if result.verdict.named]
    return {
        "top1": statistic(singles, lambda result: result.top1_correct),
        "top1_family": statistic(singles, lambda result: result.top1_family_correct(families)),
        "listed_first": statistic(singles, lambda result: result.listed_first),
        "reported": statistic(singles, lambda result: result.all_named),
        "reported_wrong": statistic(singles, lambda result: result.wrong_named),
        "cosine_top1": statistic(singles, lambda result: breakdown.names_true(result, "cosine")),
        "in_set": statistic(singles, lambda result: result.in_set),
        "set_size": statistic(named, lambda result: len(result.verdict.named[0].rows)),
        "parameter_error_pct": breakdown.strength_error(singles, nominal),
        "coverage": statistic(singles, lambda result: result.interval_covers_truth()),
        "answered": statistic(singles, lambda result: bool(result.verdict.named)),
        "top1_of_answered": statistic(named, lambda result: result.top1_correct),
    }


def _unknown_share(results: Sequence[CaseResult]) -> ScoreStatistic:
    return statistic(results, lambda result: result.declared_unknown)


def _remainder_share(results: Sequence[CaseResult]) -> ScoreStatistic:
    return statistic(results, lambda result: result.verdict.leaves_gap)


def _intervals(
    statistics: dict[str, ScoreStatistic], cases: Sequence[CaseResult]
) -> dict[str, list[float]]:
    sets = sorted({result.set_number for result in cases})
    intervals = {key: statistic.interval(sets) for key, statistic in statistics.items()}
    return {key: list(ends) for key, ends in intervals.items() if ends is not None}
