"""What scores are made of: by effect, by answer, by metric, and each case that failed."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from starling.diagnosis.validation.camera.nominal import Nominal
from starling.diagnosis.validation.protocol.answered import Answered
from starling.diagnosis.validation.protocol.figure import figure
from starling.diagnosis.validation.protocol.verdict import Named, row_of


def by_effect(singles: Sequence[Answered], nominal: Nominal) -> dict[str, dict[str, Any]]:
    """Scores of each effect that was done alone."""
    found = {}
    for row in sorted({one.rows[0] for one in singles}):
        own = [one for one in singles if one.rows[0] == row]
        found[row] = {
            "cases": len(own),
            "top1": figure(own, lambda one: one.first_right).value,
            "in_set": figure(own, lambda one: one.in_set).value,
            "parameter_error_pct": figure(
                own, lambda one: one.error_pct(nominal), median=True
            ).value,
            "closed_pct": figure(own, closed_pct, median=True).value,
        }
    return found


def confusion(known: Iterable[Answered], left_out: Iterable[Answered]) -> dict[str, dict[str, int]]:
    """Count answers by truth, the most frequent first, unknown ones last; pairs are left aside."""
    counts: dict[str, Counter[str]] = {}
    for one in known:
        if one.case.kind != "pair":
            counts.setdefault(_truth(one, ""), Counter())[one.verdict.said] += 1
    for one in left_out:
        counts.setdefault(_truth(one, "left out: "), Counter())[one.verdict.said] += 1
    return {
        truth: dict(sorted(answers.items(), key=lambda item: (-item[1], item[0])))
        for truth, answers in sorted(counts.items(), key=lambda item: (": " in item[0], item[0]))
    }


def baselines(singles: Sequence[Answered]) -> dict[str, dict[str, float | None]]:
    """Share of singles that simpler ways would have named right."""
    names = sorted({name for one in singles for name in one.verdict.baselines})
    return {
        name: {"top1": figure(singles, lambda one, name=name: _baseline_right(one, name)).value}
        for name in names
    }


def as_good(first: float | None, simpler: Mapping[str, Mapping[str, float | None]]) -> int | None:
    """How many simpler ways name as many singles right, or more; None where there is no single.

    Args:
        first: Share that the diagnosis names first.
        simpler: As `baselines` gives it.
    """
    if first is None:
        return None
    return sum((one["top1"] or 0.0) >= first for one in simpler.values())


def closed_by_metric(cases: Sequence[Answered]) -> dict[str, dict[str, float | None]]:
    """Median share closed of each metric, of cases where an effect is named and it can be told, and
    the share of these among those with an effect named.
    """
    named = [one for one in cases if one.verdict.named]
    found = {}
    for name in sorted({name for one in named for name in one.verdict.closed_pct}):
        told = figure(named, lambda one, name=name: one.verdict.closed_pct.get(name), median=True)
        found[name] = {"median": told.value, "identifiable": len(told.values) / len(named)}
    return found


def closed_pct(one: Answered) -> float:
    """Share closed of the headline metric; nothing where it cannot be told."""
    return one.verdict.headline_pct or 0.0


def failures(known: Iterable[Answered], left_out: Iterable[Answered]) -> list[dict[str, Any]]:
    """List the cases that were not answered as they should be."""
    failed = [(one, "") for one in known if not _right(one)]
    failed += [(one, "left out: ") for one in left_out if not one.unknown]
    listed = [
        {
            "case": one.case.number,
            "scenes": one.scenes,
            "truth": _truth(one, sort, strengths=True),
            "said": _said(one),
        }
        for one, sort in failed
    ]
    return sorted(listed, key=lambda item: tuple(item.values()))


def _right(one: Answered) -> bool:
    if one.case.kind == "null":
        return not one.alarm
    if one.case.kind == "single":
        return one.first_right
    return one.both_in_sets if one.case.kind == "pair" else one.unknown


def _truth(one: Answered, sort: str, *, strengths: bool = False) -> str:
    if not one.rows:
        return "no effect"
    if one.case.kind == "unknown":
        sort = "outside: "
    values = one.case.settings
    return sort + " and ".join(f"{row} {values[row]:.3g}" if strengths else row for row in one.rows)


def _said(one: Answered) -> str:
    return ", ".join(map(_listed, one.verdict.named)) or one.verdict.kind


def _listed(named: Named) -> str:
    value = named.value if isinstance(named.value, str) else f"{named.value:.3g}"
    rivals = [name for name in named.equals if name != named.name]
    return f"{named.name} {value}" + (f" (or {', '.join(rivals)})" if rivals else "")


def _baseline_right(one: Answered, name: str) -> bool:
    answer = one.verdict.baselines.get(name)
    return answer is not None and row_of(answer) in one.rows
