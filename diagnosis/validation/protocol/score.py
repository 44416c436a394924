"""How well a diagnosis named effects that were withheld from it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from starling.diagnosis.validation.camera.errors import refusal
from starling.diagnosis.validation.camera.nominal import Nominal
from starling.diagnosis.validation.protocol import breakdown
from starling.diagnosis.validation.protocol.answered import Answered
from starling.diagnosis.validation.protocol.figure import Figure, figure
from starling.diagnosis.validation.protocol.goals import REAL, goals


def score(
    answered: Sequence[Answered],
    nominal: Nominal,
    *,
    tier: int,
    families: Mapping[str, str],
    infrared: bool = True,
    left_out: Sequence[Answered] = (),
    family_alone: Sequence[Answered] = (),
) -> dict[str, Any]:
    """Score verdicts on cases.

    Args:
        answered: Cases of all kinds with the verdicts on them.
        nominal: The camera of the cases.
        tier: Of the check, 1 to 4; the goals depend on it.
        families: Of the diagnosis' effects, by name, as they were sealed.
        infrared: Whether captures held it; without, other goals are set.
        left_out: Singles once more, with the verdicts of a diagnosis that the true effect's family
            and its twins' were taken from: it ought to say that it knows none.
        family_alone: The same without the family alone: twins may rightly be named.

    Returns:
        The scores by name as JSON has them, rates in 0..1, None where no case tells. `intervals`
        are 95 % by sets of scenes, and none of real pairs, whose sets share rooms; `goals` is what
        is asked of the tier.

    Raises:
        WithheldError: if a case left out is no single, a single is at its neutral, or there is no
            such tier.
    """
    for one in (*left_out, *family_alone):
        if one.case.kind != "single":
            name = f"case {one.case.number}"
            raise refusal(name, "must be a single to be left out", one.case.kind, "Leave it away.")
    of = {
        kind: [one for one in answered if one.case.kind == kind]
        for kind in ("null", "single", "pair", "unknown")
    }
    known = [*of["null"], *of["single"], *of["pair"]]
    figures = {
        **_singles(of["single"], nominal, families),
        "false_alarm": figure(of["null"], lambda one: one.alarm),
        "false_named": figure(of["null"], lambda one: one.verdict.kind == "effects"),
        "pairs_both": figure(of["pair"], lambda one: one.both_in_sets),
        "pairs_both_named": figure(of["pair"], lambda one: one.all_named),
        "pairs_first": figure(of["pair"], lambda one: one.first_right),
        "unknown_recall": figure([*of["unknown"], *left_out], lambda one: one.unknown),
        "unknown_recall_outside": figure(of["unknown"], lambda one: one.unknown),
        "unknown_recall_left_out": figure(left_out, lambda one: one.unknown),
        "unknown_recall_family": figure(family_alone, lambda one: one.unknown),
        "unknown_false": figure(known, lambda one: one.unknown),
        "unknown_false_effects": figure([*of["single"], *of["pair"]], lambda one: one.unknown),
        **_closed([*of["single"], *of["pair"]]),
    }
    simpler = breakdown.baselines(of["single"])
    scores = {
        **{key: one.value for key, one in figures.items()},
        "baselines_as_good": breakdown.as_good(figures["top1"].value, simpler),
    }
    asked = goals(tier, scores, infrared=infrared)
    return {
        "tier": tier,
        "cases": {
            **{kind: len(cases) for kind, cases in of.items()},
            "unknown": len(of["unknown"]) + len(left_out),
        },
        **scores,
        "by_effect": breakdown.by_effect(of["single"], nominal),
        "confusion": breakdown.confusion(answered, left_out),
        "baselines": simpler,
        "closed_by_metric": breakdown.closed_by_metric([*of["single"], *of["pair"]]),
        "seconds": math.fsum(one.verdict.seconds for one in (*answered, *left_out, *family_alone)),
        "intervals": _intervals(
            {} if tier == REAL else {key: figures[key] for key in asked if key in figures},
            (*answered, *left_out),
        ),
        "goals": asked,
        "failures": breakdown.failures(answered, left_out),
    }


def _singles(
    singles: Sequence[Answered], nominal: Nominal, families: Mapping[str, str]
) -> dict[str, Figure]:
    named = [one for one in singles if one.verdict.named]
    return {
        "top1": figure(singles, lambda one: one.first_right),
        "top1_family": figure(singles, lambda one: one.family_right(families)),
        "in_set": figure(singles, lambda one: one.in_set),
        "set_size": figure(named, lambda one: len(one.verdict.named[0].rows)),
        "parameter_error_pct": figure(singles, lambda one: one.error_pct(nominal), median=True),
        "coverage": figure(singles, lambda one: one.covered()),
        "answered": figure(singles, lambda one: bool(one.verdict.named)),
        "top1_of_answered": figure(named, lambda one: one.first_right),
    }


def _closed(cases: Sequence[Answered]) -> dict[str, Figure]:
    return {
        "closed_pct": figure(cases, breakdown.closed_pct, median=True),
        "closed_not_identifiable": figure(
            cases, lambda one: bool(one.verdict.named) and one.verdict.headline_pct is None
        ),
    }


def _intervals(figures: dict[str, Figure], cases: Sequence[Answered]) -> dict[str, list[float]]:
    sets = sorted({one.scenes for one in cases})
    told = {key: one.interval(sets) for key, one in figures.items()}
    return {key: list(ends) for key, ends in told.items() if ends is not None}
