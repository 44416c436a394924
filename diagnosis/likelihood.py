"""How likely a gap is, given what an effect would make of the features."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from diagnosis.signature import Table

FREEDOM = 4.0  # Of Student's t: a feature that the simulator gets wrong must not decide alone.
TAU = 0.15  # Share of its own size by which an effect's signature is taken to be wrong.


@dataclass(frozen=True, slots=True, eq=False)
class Likelihood:
    """A gap with the deviation of each feature."""

    gap: Table  # (scenes, features) real less simulated; NaN where it is not known.
    deviation: Table  # Likewise: noise of both, and what is put down to the simulator.

    @property
    def size(self) -> float:
        """Root mean square of the gap over its deviation."""
        return float(np.sqrt(np.nanmean((self.gap / self.deviation) ** 2)))

    def beyond(self, made: Table) -> Likelihood:
        """What effects leave (scenes, features); they explain nothing to the last digit."""
        doubt = TAU * np.nan_to_num(made)
        return Likelihood(self.gap - made, np.sqrt(self.deviation**2 + doubt**2))

    def cost(self, change: NDArray[np.float64]) -> NDArray[np.float64]:
        """Negative logarithm of the likelihood for each scene.

        Args:
            change: (..., scenes, features) that an effect makes.

        Returns:
            (..., scenes), up to a constant.
        """
        known = np.isfinite(self.gap) & np.isfinite(change)
        made = np.where(known, change, 0.0)
        left = np.where(known, self.gap - made, 0.0)
        variance = self.deviation**2 + (TAU * made) ** 2
        wide = 0.5 * np.log(variance / self.deviation**2)
        off = 0.5 * (FREEDOM + 1) * np.log1p(left**2 / (FREEDOM * variance))
        # A feature that the effect makes unknown tells as much as one it leaves alone.
        return np.where(known, off + wide, self._alone(known)).sum(axis=-1)

    def _alone(self, known: NDArray[np.bool_]) -> NDArray[np.float64]:
        gap = np.nan_to_num(self.gap)
        alone = 0.5 * (FREEDOM + 1) * np.log1p(gap**2 / (FREEDOM * self.deviation**2))
        return np.broadcast_to(np.where(np.isfinite(self.gap), alone, 0.0), known.shape)
