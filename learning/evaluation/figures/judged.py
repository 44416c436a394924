"""Predicted probabilities beside what happened, at the pixels that count."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from starling.patterns.errors import refuse


@dataclass(frozen=True, slots=True, eq=False)
class Judged:
    """Pixels with a predicted probability and a known answer, in no order."""

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
    """Take the pixels that count.

    Args:
        probability: any shape, 0 to 1 where counted.
        ndp: same shape, True where the device has no depth.
        counted: same shape, where the answer counts; None = everywhere.

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
        raise refuse("counted", "must hold a pixel", 0, "Take a scene with known reference.")
    taken = probability[where].astype(np.float64)
    outside = ~((taken >= 0) & (taken <= 1))
    if outside.any():
        raise refuse(
            "probability",
            "must be in [0, 1] at every counted pixel",
            f"{taken[outside][0]:g} and {np.count_nonzero(outside) - 1} more such",
            "Give a probability, not a logit.",
        )
    return Judged(taken, ndp[where].astype(bool))


def pool(several: Iterable[Judged]) -> Judged:
    """Put the pixels of several scenes together.

    Raises:
        InputError: if there is none.
    """
    several = list(several)
    if not several:
        raise refuse("judged scenes", "must be at least one", 0, "Give a scene.")
    return Judged(
        np.concatenate([judged.probability for judged in several]),
        np.concatenate([judged.ndp for judged in several]),
    )
