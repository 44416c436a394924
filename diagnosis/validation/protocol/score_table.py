"""Scores as text tables."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

from starling.diagnosis.validation.protocol.tier import TIERS

_WIDTH = 120  # Longest line [characters].
_LABELS = {
    "top1": "one effect: top-1 accuracy",
    "top1_family": "one effect: top-1 accuracy of the family",
    "cosine_top1": "one effect: top-1 accuracy of the nearest response by cosine",
    "baselines_as_good": "one effect: baselines with at least this top-1 accuracy",
    "listed_first": "one effect: it has the largest gain, named or a surrogate",
    "reported": "one effect: it is named",
    "reported_wrong": "one effect: a wrong effect is named",
    "in_set": "one effect: in the credible set of the top-1 effect",
    "set_size": "one effect: mean size of the credible set",
    "answered": "one effect: an effect is named",
    "top1_of_answered": "one effect: top-1 accuracy of cases with a named effect",
    "parameter_error_pct": "one effect: error of the strength, median [%]",
    "coverage": "one effect: interval contains the strength",
    "false_alarm": "no effect: a gap is reported",
    "false_named": "no effect: an effect is named",
    "false_wrong": "no effect: an effect is named that the captured world lacks",
    "pairs_both": "two effects: both in credible sets",
    "pairs_both_named": "two effects: both named",
    "pairs_first": "two effects: top-1 effect is one of them",
    "unknown_recall": "unknown effect: reported as unknown",
    "unknown_recall_outside": "unknown effect: recall, effects outside the table",
    "unknown_recall_left_out": "unknown effect: recall, left out with confusable effects",
    "unknown_recall_family": "unknown effect: recall, left out with its family alone",
    "unknown_false": "none to two effects: reported as unknown",
    "unknown_false_effects": "one or two effects: reported as unknown",
    "remainder_recall": "unknown effect: a gap is reported that no known effect explains",
    "remainder_false": "none to two effects: a gap is reported that no known effect explains",
    "closed_pct": "one or two effects: closable gap closed in held-out scenes, median [%]",
    "closed_not_identifiable": "one or two effects: named, gap reduction not identifiable",
}
_REAL_NOTE = (
    "Null cases differ from their reference only by noise of the law that the diagnosis assumes, "
    "so few false positives are expected. Scene sets share rooms, so there are no intervals."
)
_MATCHER_NOTE = (
    "Only the image segment is scored. The second matcher was detected: {matcher_noticed:.2f}"
)
_REACHED = {True: "reached", False: "MISSED", None: "no cases"}


def text(scores: Mapping[str, Any]) -> str:
    """Format scores: values, intervals and goals, breakdowns, and the failed cases.

    Args:
        scores: Result of `score.score`.

    Returns:
        Lines of at most 120 characters.
    """
    counts = ", ".join(f"{count} {kind}" for kind, count in scores["cases"].items())
    answers = [
        f"{truth}: " + ", ".join(f"{name} {count}" for name, count in named.items())
        for truth, named in scores["confusion"].items()
    ]
    failures = [
        f"case {case['case']}, set {case['scenes']}: {case['truth']}: reported {case['said']}"
        for case in scores["failures"]
    ]
    blocks = [
        [f"Withheld effects, tier {scores['tier']}: {counts}; {scores['seconds']:.0f} s"],
        _goals(scores),
        _wrapped(_REAL_NOTE) if TIERS[scores["tier"]].source == "real" else [],
        [] if scores.get("matcher_noticed") is None else [_MATCHER_NOTE.format_map(scores)],
        _rows(scores["by_effect"], "single effect"),
        _rows(scores["by_range"], "strength, one effect"),
        _rows(scores["by_imperfection"], "imperfection of the base"),
        _rows(scores["closed_by_metric"], "gap reduction [%], cases with a named effect"),
        _rows(scores["baselines"], "baseline, one effect"),
        ["Answers by true effect:", *_wrapped(*answers)] if answers else [],
        [f"Failures, {len(failures)}:", *(_wrapped(*failures) or ["none"])],
    ]
    return "\n\n".join("\n".join(block) for block in blocks if block) + "\n"


def power(curves: Mapping[str, Sequence[Mapping[str, Any]]]) -> str:
    """Format power curves.

    Args:
        curves: Result of `power.curves`.
    """
    heads = ["effect", "departure", "cases", "alarm", "named", "found"]
    body = [
        [row, *(_cell(level[head]) for head in heads[1:])]
        for row, levels in curves.items()
        for level in levels
    ]
    return "\n".join(_columns([heads, *body])) + "\n"


def opening(opened: int, *, code_as_sealed: bool, sets: Mapping[str, int]) -> str:
    """Format the conditions of the scores.

    Args:
        opened: Number of times that the truth was read for scores, including this time.
        code_as_sealed: Whether the code is the sealed code.
        sets: Number of scored scene sets, "asked", and of all sets, "all".
    """
    times = "once" if opened == 1 else f"{opened} times"
    code = "is the sealed code" if code_as_sealed else "differs from the sealed code"
    scored, total = sets["asked"], sets["all"]
    note = f"The first {scored} of {total} scene sets are scored. " if scored < total else ""
    return f"{note}The truth was opened {times}; the code {code}.\n"


def _goals(scores: Mapping[str, Any]) -> list[str]:
    rows = [["score", "value", "95 %", "goal", ""]]
    for key, label in _LABELS.items():
        goal, ends = scores["goals"].get(key), scores["intervals"].get(key)
        if scores[key] is None and goal is None:
            continue
        interval = f"{_cell(ends[0])} to {_cell(ends[1])}" if ends else ""
        compared = [goal["asked"], _REACHED[goal["reached"]]] if goal else ["", ""]
        rows.append([label, _cell(scores[key]), interval, *compared])
    return _columns(rows)


def _rows(table: Mapping[str, Mapping[str, Any]], title: str) -> list[str]:
    if not table:
        return []
    heads = list(next(iter(table.values())))
    body = [[name, *(_cell(row[head]) for head in heads)] for name, row in table.items()]
    return _columns([[title, *heads], *body])


def _wrapped(*lines: str) -> list[str]:
    return [
        part
        for line in lines
        for part in textwrap.wrap(line, _WIDTH, subsequent_indent="    ", break_on_hyphens=False)
    ]


def _columns(rows: Sequence[Sequence[str]]) -> list[str]:
    """Align the first column to the left and the others to the right."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        "  ".join(
            cell.rjust(width) if number else cell.ljust(width)
            for number, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in rows
    ]


def _cell(value: float | None) -> str:
    if value is None:
        return "-"
    return str(value) if isinstance(value, int) else f"{value:.3g}"
