"""Scores of a diagnosis on cases with known effects."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from starling.diagnosis.validation.camera.errors import refusal
from starling.diagnosis.validation.camera.nominal import Nominal
from starling.diagnosis.validation.protocol import breakdown
from starling.diagnosis.validation.protocol.case_result import CaseResult
from starling.diagnosis.validation.protocol.goals import REAL_TIER, compare_with_goals
from starling.diagnosis.validation.protocol.score_statistic import ScoreStatistic, score_statistic


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
        tier: Tier of the check, 1 to 4. The goals depend on it.
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

    Raises:
        WithheldError: if a left-out case is no single, a single is at its neutral, or the tier does
            not exist.
    """
    for result in (*left_out, *family_alone):
        if result.case.kind != "single":
            name = f"case {result.case.number}"
            rule = "must be a single-effect case to be left out"
            raise refusal(name, rule, result.case.kind, "Remove it.")
    by_kind = {
        kind: [result for result in results if result.case.kind == kind]
        for kind in ("null", "single", "pair", "unknown")
    }
    known = [*by_kind["null"], *by_kind["single"], *by_kind["pair"]]
    statistics = {
        **_singles(by_kind["single"], nominal, families),
        "false_alarm": score_statistic(by_kind["null"], lambda result: result.gap_reported),
        "false_named": score_statistic(
            by_kind["null"], lambda result: result.verdict.kind == "effects"
        ),
        "pairs_both": score_statistic(by_kind["pair"], lambda result: result.both_in_sets),
        "pairs_both_named": score_statistic(by_kind["pair"], lambda result: result.all_named),
        "pairs_first": score_statistic(by_kind["pair"], lambda result: result.top1_correct),
        "unknown_recall": score_statistic(
            [*by_kind["unknown"], *left_out], lambda result: result.declared_unknown
        ),
        "unknown_recall_outside": score_statistic(
            by_kind["unknown"], lambda result: result.declared_unknown
        ),
        "unknown_recall_left_out": score_statistic(
            left_out, lambda result: result.declared_unknown
        ),
        "unknown_recall_family": score_statistic(
            family_alone, lambda result: result.declared_unknown
        ),
        "unknown_false": score_statistic(known, lambda result: result.declared_unknown),
        "unknown_false_effects": score_statistic(
            [*by_kind["single"], *by_kind["pair"]], lambda result: result.declared_unknown
        ),
        **_closed([*by_kind["single"], *by_kind["pair"]]),
    }
    baseline_scores = breakdown.baselines(by_kind["single"])
    scores = {
        **{key: statistic.value for key, statistic in statistics.items()},
        "baselines_as_good": breakdown.count_as_good(statistics["top1"].value, baseline_scores),
    }
    compared = compare_with_goals(tier, scores, infrared=infrared)
    return {
        "tier": tier,
        "cases": {
            **{kind: len(cases) for kind, cases in by_kind.items()},
            "unknown": len(by_kind["unknown"]) + len(left_out),
        },
        **scores,
        "by_effect": breakdown.by_effect(by_kind["single"], nominal),
        "confusion": breakdown.confusion(results, left_out),
        "baselines": baseline_scores,
        "closed_by_metric": breakdown.closed_by_metric([*by_kind["single"], *by_kind["pair"]]),
        "seconds": math.fsum(
            result.verdict.seconds for result in (*results, *left_out, *family_alone)
        ),
        "intervals": _intervals(
            {}
            if tier == REAL_TIER
            else {key: statistics[key] for key in compared if key in statistics},
            (*results, *left_out),
        ),
        "goals": compared,
        "failures": breakdown.failures(results, left_out),
    }


def _singles(
    singles: Sequence[CaseResult], nominal: Nominal, families: Mapping[str, str]
) -> dict[str, ScoreStatistic]:
    named = [result for result in singles if result.verdict.named]
    return {
        "top1": score_statistic(singles, lambda result: result.top1_correct),
        "top1_family": score_statistic(
            singles, lambda result: result.top1_family_correct(families)
        ),
        "in_set": score_statistic(singles, lambda result: result.in_set),
        "set_size": score_statistic(named, lambda result: len(result.verdict.named[0].rows)),
        "parameter_error_pct": score_statistic(
            singles, lambda result: result.error_pct(nominal), median=True
        ),
        "coverage": score_statistic(singles, lambda result: result.interval_covers_truth()),
        "answered": score_statistic(singles, lambda result: bool(result.verdict.named)),
        "top1_of_answered": score_statistic(named, lambda result: result.top1_correct),
    }


def _closed(cases: Sequence[CaseResult]) -> dict[str, ScoreStatistic]:
    return {
        "closed_pct": score_statistic(cases, breakdown.closed_pct, median=True),
        "closed_not_identifiable": score_statistic(
            cases, lambda result: bool(result.verdict.named) and result.verdict.headline_pct is None
        ),
    }


def _intervals(
    statistics: dict[str, ScoreStatistic], cases: Sequence[CaseResult]
) -> dict[str, list[float]]:
    sets = sorted({result.set_number for result in cases})
    intervals = {key: statistic.interval(sets) for key, statistic in statistics.items()}
    return {key: list(ends) for key, ends in intervals.items() if ends is not None}
