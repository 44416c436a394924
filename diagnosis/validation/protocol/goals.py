"""Goals of the scores, by tier of the check."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from starling.diagnosis.validation.camera.errors import refusal

TIERS = (1, 2, 3, 4)
REAL_TIER = 4  # Tier of real pairs, whose sets share scenes.
_SAME_RENDERER = (1, 3)  # Tiers with the renderer and matcher of the diagnosis; higher goals.


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

    Raises:
        WithheldError: if the tier does not exist.
    """
    if tier not in TIERS:
        raise refusal("tier", f"must be one of {TIERS}", tier, "Give one of them.")
    goals = _WITHOUT_INFRARED
    if infrared:
        goals = {key: pair[0 if tier in _SAME_RENDERER else 1] for key, pair in _GOALS.items()}
    return {
        key: {"asked": goal.bounds, "reached": goal.reached(scores[key])}
        for key, goal in goals.items()
    }
