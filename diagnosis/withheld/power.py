"""Power curves: how often an effect is found, by how strong it is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from diagnosis.withheld.answered import Answered
from diagnosis.withheld.catalogue import ROWS
from diagnosis.withheld.errors import refusal
from diagnosis.withheld.figure import figure
from diagnosis.withheld.nominal import Nominal


def curves(
    answered: Sequence[Answered], nominal: Nominal, levels: Mapping[str, Sequence[float]]
) -> dict[str, list[dict[str, Any]]]:
    """Count what was found at each departure from the neutral.

    Args:
        answered: Singles with the verdicts on them.
        nominal: The camera of the cases.
        levels: Departures by effect; a case counts at the nearest.

    Returns:
        By effect and rising departure, the cases, the share whose first named effect is right
        (`named`) and that with the truth in its set (`found`), None where there are no cases.

    Raises:
        WithheldError: if a case is no single or its effect has no level.
    """
    cases: dict[str, dict[float, list[Answered]]] = {
        row: {float(level): [] for level in sorted(given)} for row, given in levels.items()
    }
    for one in answered:
        if one.case.kind != "single":
            name = f"case {one.case.number}"
            raise refusal(name, "must be a single for a power curve", one.case.kind, "Drop it.")
        row = one.rows[0]
        at = cases.get(row)
        if not at:
            raise refusal("levels", f"must have one of {row}", sorted(levels), "Give them.")
        departure = ROWS[row].departure(nominal, one.case.settings[row])
        at[min(at, key=lambda level: abs(level - departure))].append(one)
    return {
        row: [
            {
                "departure": level,
                "cases": len(those),
                "named": figure(those, lambda one: one.first_right).value,
                "found": figure(those, lambda one: one.in_set).value,
            }
            for level, those in at.items()
        ]
        for row, at in cases.items()
    }
