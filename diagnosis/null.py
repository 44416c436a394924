"""What the base itself scatters: its noise, and how far the best of all effects gains by chance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from diagnosis.candidates import Arm
from diagnosis.fit import fit
from diagnosis.likelihood import Likelihood
from diagnosis.signature import Bench, Signature, Table

SEEDS = 8
FLOOR = 0.02  # What the simulator is taken to be wrong by in every feature, in its own unit.
LEAST_GAIN = 12.0  # Below this no effect is believed, whatever the nulls say.


@dataclass(frozen=True, slots=True, eq=False)
class Base:
    """Features of the base under several seeds."""

    tables: NDArray[np.float64]  # (seeds, scenes, features); the first has the signatures' seed.

    @property
    def mean(self) -> Table:
        """Mean over seeds."""
        return _mean(self.tables, axis=0)

    @property
    def deviation(self) -> NDArray[np.float64]:
        """Deviation (features,) of a reading less the mean, and of what the simulator misses."""
        seeds = len(self.tables)
        squares = _mean((self.tables - self.mean) ** 2, axis=(0, 1))
        variance = squares * seeds / max(seeds - 1, 1) * (1 + 1 / seeds)
        return np.sqrt(np.nan_to_num(variance) + FLOOR**2)

    def likelihood(self, real: Table) -> Likelihood:
        """Likelihood of a reading's gap."""
        return Likelihood(real - self.mean, np.broadcast_to(self.deviation, real.shape))


def _mean(values: NDArray[np.float64], axis: int | tuple[int, ...]) -> NDArray[np.float64]:
    """Mean of what is known; NaN where nothing is."""
    known = np.isfinite(values)
    count = known.sum(axis=axis)
    total = np.where(known, values, 0.0).sum(axis=axis)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def base(bench: Bench, *, seeds: int = SEEDS) -> Base:
    """Simulate the base; matching a real pair again draws nothing, so there one table is all."""
    numbers = range(1 if bench.arm is Arm.DEPTH else seeds)
    return Base(np.stack([bench.simulated({}, seed=number) for number in numbers]))


def gains(
    of: Base, signatures: Sequence[Signature], folds: Sequence[NDArray[np.bool_]]
) -> NDArray[np.float64]:
    """Held-out gain of the best effect where there is none to find, for each seed left out."""
    found = []
    for number in range(len(of.tables) if len(of.tables) > 1 else 0):
        rest = Base(np.delete(of.tables, number, axis=0))
        likelihood = rest.likelihood(of.tables[number])
        best = [fit(one, likelihood, folds).gain.sum() for one in signatures]
        found.append(max(best, default=0.0))
    return np.array(found)


def threshold(null_gains: NDArray[np.float64], *, alpha: float = 0.05) -> float:
    """Gain that chance reaches with probability alpha, at least `LEAST_GAIN`."""
    if null_gains.size == 0:
        return LEAST_GAIN
    return max(LEAST_GAIN, float(np.quantile(null_gains, 1 - alpha)))
