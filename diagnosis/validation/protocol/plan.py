"""Plans of an imperfect base: which imperfections the captures of each case have."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from starling.diagnosis.validation.camera.errors import refusal
from starling.diagnosis.validation.camera.imperfections import IMPERFECTIONS, SPOTS

ALL, EACH = "all", "each"
PLANS = (ALL, EACH, *IMPERFECTIONS)  # All at once, one by one in turn, or always the same.


def check(plan: str) -> None:
    """Check the name of a plan.

    Raises:
        WithheldError: if there is no such plan.
    """
    if plan not in PLANS:
        raise refusal("imperfect", f"must be one of {list(PLANS)}", plan, "Take one of them.")


def draw(plan: str, count: int, rng: np.random.Generator) -> list[dict[str, float]]:
    """Draw the imperfections of cases at random.

    Args:
        plan: One of `PLANS`. With `EACH`, successive cases cycle through the imperfections.
        count: Number of cases.
        rng: Random generator of the cases.

    Returns:
        Strengths by imperfection, for each case.

    Raises:
        WithheldError: if there is no such plan.
    """
    check(plan)
    names = list(IMPERFECTIONS)
    start = int(rng.integers(len(names)))
    return [_strengths(_names(plan, names, start + number, rng), rng) for number in range(count)]


def _names(plan: str, names: Sequence[str], number: int, rng: np.random.Generator) -> list[str]:
    if plan == ALL:
        spot = SPOTS[int(rng.integers(len(SPOTS)))]
        return [name for name in names if name == spot or name not in SPOTS]
    return [names[number % len(names)]] if plan == EACH else [plan]


def _strengths(names: Sequence[str], rng: np.random.Generator) -> dict[str, float]:
    rows = {name: IMPERFECTIONS[name] for name in names}
    return {name: float(rng.uniform(row.least, row.most)) for name, row in rows.items()}
