"""Predicted probabilities and outcomes at the counted pixels."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from starling.patterns.errors import refuse


@dataclass(frozen=True, slots=True, eq=False)
class Judged:
    """Pixels with predicted probability and known outcome, unordered."""

    probability: NDArray[np.float64]  # (n,) that a pixel has no depth, 0 to 1.
    ndp: NDArray[np.bool_]  # (n,) whether it has none.

    @property
    def share(self) -> float:
        """Share of the pixels that have no depth, 0 to 1."""
        return float(self.ndp.mean())


def judge(
    probability: NDArray[np.floating],
    ndp: NDArray[np.bool_],
    counted: NDArray[np.bool_] | None = None,
) -> Judged:
    """Select the counted pixels.

    Args:
        probability: any shape, 0 to 1 where counted.
        ndp: same shape, True where the device has no depth.
        counted: same shape, where the outcome counts; None = everywhere.

    Raises:
        InputError: if the shapes differ, no pixel counts, or a counted probability is outside
            [0, 1] or NaN.
    """
    where = np.ones(ndp.shape, bool) if counted is None else counted
    if not probability.shape == ndp.shape == where.shape:
        raise refuse(
            "probability, ndp and counted",
            "must share one shape",
            f"{probability.shape}, {ndp.shape} and {where.shape}",
            "Give three images of one view.",
        )
    if not where.any():
        raise refuse("counted", "must hold a pixel", 0, "Use a scene with known reference depth.")
    selected = probability[where].astype(np.float64)
    outside = ~((selected >= 0) & (selected <= 1))
    if outside.any():
        raise refuse(
            "probability",
            "must be in [0, 1] at every counted pixel",
            f"{selected[outside][0]:g} and {np.count_nonzero(outside) - 1} more",
            "Give a probability, not a logit.",
        )
    return Judged(selected, ndp[where].astype(bool))


def pool(scenes: Iterable[Judged]) -> Judged:
    """Pool the pixels of several scenes.

    Raises:
        InputError: if there is none.
    """
    scenes = list(scenes)
    if not scenes:
        raise refuse("judged scenes", "must be at least one", 0, "Give a scene.")
    return Judged(
        np.concatenate([judged.probability for judged in scenes]),
        np.concatenate([judged.ndp for judged in scenes]),
    )
