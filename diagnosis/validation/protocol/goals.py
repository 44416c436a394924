"""What is asked of a diagnosis, by tier of the check."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from starling.diagnosis.validation.camera.errors import refusal

TIERS = (1, 2, 3, 4)
REAL = 4  # That of real pairs, whose sets share scenes.
_OWN = (1, 3)  # Those whose renderer and matcher the diagnosis shares: goals are higher.


@dataclass(frozen=True, kw_only=True, slots=True)
class Goal:
    """Bounds of a score, themselves allowed."""

    least: float = -math.inf
    most: float = math.inf
    percent: bool = False

    @property
    def asked(self) -> str:
        """The bounds in words."""
        if math.isinf(self.least):
            return f"<= {self._number(self.most)}"
        if math.isinf(self.most):
            return f">= {self._number(self.least)}"
        return f"{self._number(self.least)} to {self._number(self.most)}"

    def reached(self, value: float | None) -> bool | None:
        """Tell whether a score is within the bounds; None of none."""
        return None if value is None else self.least <= value <= self.most

    def _number(self, value: float) -> str:
        if self.percent:
            return f"{value:.0f} %"
        return str(value) if isinstance(value, int) else f"{value:.2f}"


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
    "closed_pct": (Goal(least=85, percent=True), Goal(least=60, percent=True)),
}


# Of depth and holes alone an answer is not asked for in every case.
_WITHOUT_INFRARED = {
    "answered": Goal(least=0.60),
    "top1_of_answered": Goal(least=0.70),
    "baselines_as_good": Goal(most=0),
    "false_alarm": Goal(most=0.05),
}


def goals(
    tier: int, scores: Mapping[str, float | None], *, infrared: bool = True
) -> dict[str, dict[str, Any]]:
    """Set what is asked beside what was reached.

    Args:
        tier: Of the check.
        scores: By name, at least those that something is asked of.
        infrared: Whether captures held it.

    Returns:
        By score, what is asked, and whether it is reached (None where no case tells).

    Raises:
        WithheldError: if there is no such tier.
    """
    if tier not in TIERS:
        raise refusal("tier", f"must be one of {TIERS}", tier, "Give one of them.")
    asked = _WITHOUT_INFRARED
    if infrared:
        asked = {key: pair[0 if tier in _OWN else 1] for key, pair in _GOALS.items()}
    return {
        key: {"asked": goal.asked, "reached": goal.reached(scores[key])}
        for key, goal in asked.items()
    }
