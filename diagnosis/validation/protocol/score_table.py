"""Scores as text."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

from starling.diagnosis.validation.protocol.goals import REAL

_WIDTH = 120
_WORDS = {
    "top1": "one effect: named first",
    "top1_family": "one effect: its family named first",
    "baselines_as_good": "one effect: simpler ways that name as many first",
    "in_set": "one effect: in the set named first",
    "set_size": "one effect: mean size of that set",
    "answered": "one effect: an effect named at all",
    "top1_of_answered": "one effect: named first, where one is named",
    "parameter_error_pct": "one effect: error of its strength, median [%]",
    "coverage": "one effect: strength within the interval",
    "false_alarm": "no effect: a gap alarmed of",
    "false_named": "no effect: an effect named",
    "pairs_both": "two effects: both in sets",
    "pairs_both_named": "two effects: both named",
    "pairs_first": "two effects: one of them named first",
    "unknown_recall": "unknown effects: said to be unknown",
    "unknown_recall_outside": "unknown effects: of those in no table",
    "unknown_recall_left_out": "unknown effects: of those left out with their twins",
    "unknown_recall_family": "unknown effects: of those left out without twins",
    "unknown_false": "others: said to be unknown",
    "unknown_false_effects": "one or two effects: said to be unknown",
    "closed_pct": "one or two effects: gap closed, median [%]",
    "closed_not_identifiable": "one or two effects: named, closing not told",
}
_REACHED = {True: "reached", False: "MISSED", None: "not told"}


def text(scores: Mapping[str, Any]) -> str:
    """Write scores for people: asked beside reached, and all that failed.

    Args:
        scores: As `score.score` gives them.

    Returns:
        Lines of at most 120 characters.
    """
    counts = ", ".join(f"{count} {kind}" for kind, count in scores["cases"].items())
    parts = [
        ("", [f"Withheld effects, tier {scores['tier']}: {counts}; {scores['seconds']:.0f} s"]),
        ("", _goals(scores)),
        ("", _real(scores["tier"])),
        ("", _matcher(scores.get("matcher_noticed"))),
        ("", _rows(scores["by_effect"], "effect done alone")),
        ("", _rows(scores["closed_by_metric"], "gap closed [%], where an effect is named")),
        ("", _rows(scores["baselines"], "simpler ways, one effect")),
        ("Answers by truth:", _confusion(scores["confusion"])),
        (f"Failures, {len(scores['failures'])}:", _failures(scores["failures"])),
    ]
    blocks = ["\n".join([title, *lines] if title else lines) for title, lines in parts if lines]
    return "\n\n".join(blocks) + "\n"


def power(curves: Mapping[str, Sequence[Mapping[str, Any]]]) -> str:
    """Write power curves for people.

    Args:
        curves: As `power.curves` gives them.
    """
    heads = ["effect", "departure", "cases", "alarm", "named", "found"]
    body = [
        [row, *(_cell(level[head]) for head in heads[1:])]
        for row, levels in curves.items()
        for level in levels
    ]
    return "\n".join(_columns([heads, *body])) + "\n"


def opening(opened: int, *, code_as_sealed: bool, sets: Mapping[str, int]) -> str:
    """Say what the scores rest on.

    Args:
        opened: How often the truth was opened, this time included.
        code_as_sealed: Whether the code is still the one that was sealed.
        sets: How many sets of scenes were "asked", and how many "all" are.
    """
    times = "once" if opened == 1 else f"{opened} times"
    code = "as it was sealed" if code_as_sealed else "another than was sealed"
    part, every = sets["asked"], sets["all"]
    some = f"Of {every} sets of scenes the first {part} were asked. " if part < every else ""
    return f"{some}The truth was opened {times}; the code is {code}.\n"


def _goals(scores: Mapping[str, Any]) -> list[str]:
    rows = [["score", "reached", "95 %", "asked", ""]]
    asked = scores["goals"]
    told = {key: words for key, words in _WORDS.items() if scores[key] is not None or key in asked}
    for key, words in told.items():
        goal = asked.get(key)
        ends = scores["intervals"].get(key)
        rows.append(
            [
                words,
                _cell(scores[key]),
                f"{_cell(ends[0])} to {_cell(ends[1])}" if ends else "",
                goal["asked"] if goal else "",
                _REACHED[goal["reached"]] if goal else "",
            ]
        )
    return _columns(rows)


def _real(tier: int) -> list[str]:
    if tier != REAL:
        return []
    return _wrapped(
        "A null differs from its partner by noise of the law that alarms are guarded by, and sets "
        "share rooms: few alarms are built in, and there are no intervals."
    )


def _matcher(noticed: float | None) -> list[str]:
    if noticed is None:
        return []
    return [f"scored is the image alone; that the matcher is another was noticed: {noticed:.2f}"]


def _rows(table: Mapping[str, Mapping[str, Any]], title: str) -> list[str]:
    if not table:
        return []
    heads = list(next(iter(table.values())))
    body = [[name, *(_cell(row[head]) for head in heads)] for name, row in table.items()]
    return _columns([[title, *heads], *body])


def _confusion(table: Mapping[str, Mapping[str, int]]) -> list[str]:
    return [
        line
        for truth, answers in table.items()
        for line in _wrapped(
            f"{truth}: " + ", ".join(f"{name} {count}" for name, count in answers.items())
        )
    ]


def _failures(failed: Sequence[Mapping[str, Any]]) -> list[str]:
    lines = [
        f"case {one['case']}, scenes {one['scenes']}: {one['truth']}: said {one['said']}"
        for one in failed
    ]
    return [part for line in lines for part in _wrapped(line)] or ["none"]


def _wrapped(line: str) -> list[str]:
    return textwrap.wrap(line, _WIDTH, subsequent_indent="    ", break_on_hyphens=False)


def _columns(rows: Sequence[Sequence[str]]) -> list[str]:
    """Align cells, the first column to the left, the others to the right."""
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
