"""What effects do to the features of every scene."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, eq=False)
class Made:
    """A change, and how far another device or another exposure would have another."""

    change: NDArray[np.float64]  # (..., scenes, features)
    scatter: NDArray[np.float64] | float = 0.0  # Variance, (..., 1, features).

    def __add__(self, other: Made) -> Made:
        """Both at once, as if neither knew of the other."""
        return Made(self.change + other.change, self.scatter + other.scatter)


def stacked(many: Sequence[Made]) -> Made:
    """Put some in a row, (many, scenes, features).

    Args:
        many: of the same scenes, at least one.
    """
    width = many[0].change.shape[-1]
    scatter = [np.broadcast_to(one.scatter, (1, width)) for one in many]
    return Made(np.stack([one.change for one in many]), np.stack(scatter))
