"""One effect fitted to a gap, and judged on scenes that it was not fitted to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from diagnosis.likelihood import Likelihood
from diagnosis.signature import Signature
from sim.effects.effect import Value

FOLDS = 4
_STEPS = 32  # Places tried between two nodes.


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """A candidate's best strength, and what it gains."""

    signature: Signature
    place: float
    gain: NDArray[np.float64]  # (scenes,) gain in log likelihood, each held out.
    cost: NDArray[np.float64]  # (places, scenes)
    places: NDArray[np.float64]

    @property
    def name(self) -> str:
        """The candidate's."""
        return self.signature.candidate.name

    @property
    def value(self) -> Value:
        """Its strength."""
        return self.signature.value(self.place)

    def interval(self, *, level: float, seed: int, draws: int = 400) -> tuple[Value, Value]:
        """Bootstrap its strength over scenes."""
        rng = np.random.default_rng(seed)
        scenes = self.cost.shape[1]
        times = rng.multinomial(scenes, np.full(scenes, 1 / scenes), size=draws)
        best = self.places[np.argmin(self.cost @ times.T, axis=0)]
        low, high = np.quantile(best, ((1 - level) / 2, (1 + level) / 2))
        return self.signature.value(float(low)), self.signature.value(float(high))


def fit(signature: Signature, likelihood: Likelihood, folds: Sequence[NDArray[np.bool_]]) -> Fit:
    """Fit a candidate on all scenes but a fold's, and judge it there.

    Args:
        signature: of the candidate.
        likelihood: of the gap.
        folds: masks (scenes,) of the scenes held out in each.
    """
    places = _places(signature)
    cost = np.stack([likelihood.cost(signature.at(place)) for place in places])
    nothing = likelihood.cost(np.zeros_like(likelihood.gap))
    gain = np.zeros(cost.shape[1])
    for held in folds:
        best = int(np.argmin(cost[:, ~held].sum(axis=1)))
        gain[held] = (nothing - cost[best])[held]
    return Fit(signature, float(places[int(np.argmin(cost.sum(axis=1)))]), gain, cost, places)


def _places(signature: Signature) -> NDArray[np.float64]:
    last = len(signature.values) - 1
    steps = last * _STEPS if signature.candidate.numeric else last
    return np.linspace(0, last, steps + 1)


def folds(scenes: int, *, seed: int = 0) -> list[NDArray[np.bool_]]:
    """Part scenes into folds, at most as many as there are scenes."""
    count = min(FOLDS, scenes)
    number = np.random.default_rng(seed).permutation(scenes) % count
    return [number == fold for fold in range(count)]
