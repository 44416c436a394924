"""Breakdown of the scores by effect, by answer and by metric, and the list of failed cases."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from starling.diagnosis.validation.camera.catalogue import ROWS
from starling.diagnosis.validation.camera.nominal import Nominal
from starling.diagnosis.validation.protocol.score_statistic import ScoreStatistic, statistic
from starling.diagnosis.validation.protocol.verdict import CaseResult, NamedEffect, row_of

_ROUNDING = 1e-9  # Relative rounding of strengths at the end of a range.


def by_effect(singles: Sequence[CaseResult], nominal: Nominal) -> dict[str, dict[str, Any]]:
    """Compute the scores of each effect from the single-effect cases."""
    by_row: dict[str, list[CaseResult]] = {}
    for result in sorted(singles, key=lambda result: result.rows[0]):
        by_row.setdefault(result.rows[0], []).append(result)
    return {
        row: {
            "cases": len(results),
            "top1": statistic(results, lambda result: result.top1_correct).value,
            "in_set": statistic(results, lambda result: result.in_set).value,
            "parameter_error_pct": strength_error(results, nominal).value,
            "closed_pct": statistic(results, closed_pct, median=True).value,
        }
        for row, results in by_row.items()
    }


def by_range(singles: Sequence[CaseResult], nominal: Nominal) -> dict[str, dict[str, Any]]:
    """Compute the scores of single-effect cases within and beyond the range of the table.

    Returns:
        By range, the scores; empty if all strengths are within.
    """
    beyond = [result for result in singles if _is_beyond(result, nominal)]
    if not beyond:
        return {}
    within = [result for result in singles if result not in beyond]
    return {
        name: {**_reported(results), "parameter_error_pct": strength_error(results, nominal).value}
        for name, results in (("within the range", within), ("beyond the range", beyond))
    }


def by_imperfection(results: Sequence[CaseResult]) -> dict[str, dict[str, Any]]:
    """Compute the scores of the cases whose captures have each imperfection of the base.

    Returns:
        By imperfection, the scores; empty with a perfect base.
    """
    names = sorted({name for result in results for name in result.case.imperfections})
    rows = {}
    for name in names:
        having = [result for result in results if name in result.case.imperfections]
        null, single, pair, unknown = (
            [result for result in having if result.case.kind == kind]
            for kind in ("null", "single", "pair", "unknown")
        )
        rows[name] = {
            **_reported(single),
            "pairs": statistic(pair, lambda result: result.both_in_sets).value,
            "nulls": len(null),
            "null_named": statistic(null, lambda result: result.wrong_named).value,
            "unknown_named": statistic(unknown, lambda result: result.wrong_named).value,
        }
    return rows


def _reported(singles: Sequence[CaseResult]) -> dict[str, Any]:
    return {
        "singles": len(singles),
        "first": statistic(singles, lambda result: result.listed_first).value,
        "reported": statistic(singles, lambda result: result.all_named).value,
        "wrong": statistic(singles, lambda result: result.wrong_named).value,
        "cosine": statistic(singles, lambda result: names_true(result, "cosine")).value,
        "closed_pct": statistic(singles, closed_pct, median=True).value,
    }


def _is_beyond(result: CaseResult, nominal: Nominal) -> bool:
    ((name, value),) = result.case.settings.items()
    row = ROWS[name]
    if row.scale == "choice":
        return False
    sign = 1 if value >= row.neutral_of(nominal) else -1
    return row.departure(nominal, value) > row.reach(nominal, sign) * (1.0 + _ROUNDING)


def strength_error(results: Sequence[CaseResult], nominal: Nominal) -> ScoreStatistic:
    """Return the error of the strength [%] over the cases with a correct top-1 effect."""
    return statistic(results, lambda result: result.error_pct(nominal), median=True)


def confusion(
    known: Iterable[CaseResult], left_out: Iterable[CaseResult]
) -> dict[str, dict[str, int]]:
    """Count the answers by true effect. Pairs are excluded.

    Answers are sorted by frequency. Unknown effects come after the known ones.
    """
    counts: dict[str, Counter[str]] = {}
    for result in known:
        if result.case.kind != "pair":
            counts.setdefault(_truth(result, ""), Counter())[result.verdict.answer] += 1
    for result in left_out:
        counts.setdefault(_truth(result, "left out: "), Counter())[result.verdict.answer] += 1
    return {
        truth: dict(sorted(answers.items(), key=lambda item: (-item[1], item[0])))
        for truth, answers in sorted(counts.items(), key=lambda item: (": " in item[0], item[0]))
    }


def baselines(singles: Sequence[CaseResult]) -> dict[str, dict[str, float | None]]:
    """Compute the top-1 accuracy of each baseline method on the single-effect cases."""
    names = sorted({name for result in singles for name in result.verdict.baselines})
    return {
        name: {
            "top1": statistic(
                singles, lambda result, name=name: bool(names_true(result, name))
            ).value
        }
        for name in names
    }


def names_true(result: CaseResult, baseline: str) -> bool | None:
    """Return whether a baseline method names a true effect, or None if it was not run."""
    if baseline not in result.verdict.baselines:
        return None
    answer = result.verdict.baselines[baseline]
    return answer is not None and row_of(answer) in result.rows


def count_as_good(
    top1: float | None, scores: Mapping[str, Mapping[str, float | None]]
) -> int | None:
    """Count the baselines whose top-1 accuracy is at least that of the diagnosis.

    Args:
        top1: Top-1 accuracy of the diagnosis; None without a single-effect case.
        scores: Result of `baselines`.

    Returns:
        The count, or None without a single-effect case.
    """
    if top1 is None:
        return None
    return sum((baseline["top1"] or 0.0) >= top1 for baseline in scores.values())


def closed_by_metric(cases: Sequence[CaseResult]) -> dict[str, dict[str, float | None]]:
    """Compute the gap reduction of each metric over the cases with a named effect.

    Returns:
        By metric, the median [%] over the cases where it is identifiable, and the share of these
        cases.
    """
    named = [result for result in cases if result.verdict.named]
    metrics = {}
    for name in sorted({name for result in named for name in result.verdict.closed_pct}):
        reduction = statistic(
            named, lambda result, name=name: result.verdict.closed_pct.get(name), median=True
        )
        metrics[name] = {
            "median": reduction.value,
            "identifiable": len(reduction.values) / len(named),
        }
    return metrics


def closed_pct(result: CaseResult) -> float:
    """Return the gap reduction of the headline metric [%], 0 if it is not identifiable."""
    return result.verdict.headline_pct or 0.0


def failures(known: Iterable[CaseResult], left_out: Iterable[CaseResult]) -> list[dict[str, Any]]:
    """List the cases with a wrong answer."""
    failed = [(result, "") for result in known if not _correct(result)]
    failed += [(result, "left out: ") for result in left_out if not result.declared_unknown]
    rows = [
        {
            "case": result.case.number,
            "scenes": result.set_number,
            "truth": _truth(result, prefix, strengths=True),
            "said": _answer(result),
        }
        for result, prefix in failed
    ]
    return sorted(rows, key=lambda item: tuple(item.values()))


def _correct(result: CaseResult) -> bool:
    if result.case.kind == "null":
        # An imperfect base has a gap that no effect explains.
        return not (result.wrong_named if result.case.imperfections else result.gap_reported)
    if result.case.kind == "single":
        return result.top1_correct
    return result.both_in_sets if result.case.kind == "pair" else result.declared_unknown


def _truth(result: CaseResult, prefix: str, *, strengths: bool = False) -> str:
    if not result.rows:
        return "no effect"
    if result.case.kind == "unknown":
        prefix = "outside: "
    values = result.case.settings
    return prefix + " and ".join(
        f"{row} {values[row]:.3g}" if strengths else row for row in result.rows
    )


def _answer(result: CaseResult) -> str:
    return ", ".join(map(_format_effect, result.verdict.named)) or result.verdict.kind


def _format_effect(named: NamedEffect) -> str:
    value = named.value if isinstance(named.value, str) else f"{named.value:.3g}"
    equivalent = [name for name in named.credible_set if name != named.name]
    return f"{named.name} {value}" + (f" (or {', '.join(equivalent)})" if equivalent else "")
