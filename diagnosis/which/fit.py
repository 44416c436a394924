"""One effect fitted to a gap, and judged on scenes that it was not fitted to."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from starling.diagnosis.scenes.rooms import draws as drawn_anew
from starling.diagnosis.which.likelihood import Likelihood
from starling.diagnosis.which.predicted import Made, stacked
from starling.diagnosis.which.response import Signature
from starling.sim.effects.effect import Value

FOLDS = 4
_STEPS = 16  # Places tried between two nodes.
_DRAWS = 400  # Of rooms.

Folds = Sequence[NDArray[np.bool_]]


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
        return self.signature.name

    @property
    def value(self) -> Value:
        """Its strength."""
        return self.signature.value(self.place)

    @property
    def total(self) -> float:
        """Held-out gain of all scenes."""
        return float(self.gain.sum())

    def interval(self, rooms: Sequence[str], *, level: float) -> tuple[Value, Value]:
        """Strengths that rooms drawn anew would give, and those that all fit nearly as well.

        What the simulator gets wrong is the same in every scene, so all of them together count as
        one: the likelihood's mean over scenes may fall by half of chi-square's quantile.

        Args:
            rooms: that of each scene.
            level: of the interval.

        Returns:
            Both ends; of a choice those of what cannot be told apart, as they are listed.
        """
        times = drawn_anew(rooms, _DRAWS, np.random.default_rng(0))
        best = self.places[np.argmin(self.cost @ times.T, axis=0)]
        ends = ((1 - level) / 2, (1 + level) / 2)
        numeric = self.signature.candidate.numeric
        low, high = np.quantile(best, ends, method="linear" if numeric else "nearest")
        mean = self.cost.mean(axis=1)
        near = self.places[mean <= mean.min() + 0.5 * stats.chi2.ppf(level, 1)]
        between_steps = numeric and not self.signature.candidate.whole
        half_a_step = 0.5 * float(self.places[1] - self.places[0]) if between_steps else 0.0
        low = max(min(low, near[0]) - half_a_step, self.places[0])
        high = min(max(high, near[-1]) + half_a_step, self.places[-1])
        if numeric:
            return self.signature.value(float(low)), self.signature.value(float(high))
        between = self.signature.values[int(low) : int(high) + 1]
        if any(isinstance(one, str) for one in between):
            return between[0], between[-1]
        return min(between, key=float), max(between, key=float)


def fit(
    signature: Signature,
    likelihood: Likelihood,
    folds: Folds,
    *,
    given: Made | None = None,
    over: Made | None = None,
    steps: int = _STEPS,
) -> Fit:
    """Fit a candidate on all scenes but a fold's, and judge it there.

    Args:
        signature: of the candidate.
        likelihood: of the gap.
        folds: masks (scenes,) of the scenes held out in each.
        given: what other effects make beside it; None where there are none.
        over: what they make without it, which the gain is over; None where that is the same.
        steps: places tried between two nodes.
    """
    given = likelihood.nothing if given is None else given
    tried = places(signature, steps)
    cost = likelihood.cost(stacked([given + signature.at(place) for place in tried]))
    nothing = likelihood.cost(given if over is None else over)
    gain = held_out(cost, nothing, folds)
    return Fit(signature, float(tried[int(np.argmin(cost.sum(axis=1)))]), gain, cost, tried)


def held_out(
    cost: NDArray[np.float64],
    nothing: NDArray[np.float64],
    folds: Folds,
) -> NDArray[np.float64]:
    """Gain (scenes,) of the choice that the other scenes make.

    Args:
        cost: (choices, scenes).
        nothing: (scenes,) cost without any.
        folds: masks (scenes,).
    """
    gain = np.zeros_like(nothing)
    for held in folds:
        best = int(np.argmin(cost[:, ~held].sum(axis=1)))
        gain[held] = (nothing - cost[best])[held]
    return gain


def places(signature: Signature, steps: int) -> NDArray[np.float64]:
    """Places from the first value to the last; of words the values' own, of what takes whole
    numbers alone those of such.

    Args:
        signature: of a candidate.
        steps: from one value to the next.
    """
    last = len(signature.values) - 1
    if signature.candidate.whole:
        values = np.array(signature.values, float)
        between = [np.rint(np.linspace(*ends, steps + 1)) for ends in itertools.pairwise(values)]
        return np.interp(np.unique(between), values, np.arange(last + 1))
    return np.linspace(0, last, (last * steps if signature.candidate.numeric else last) + 1)


def folds(rooms: Sequence[str]) -> list[NDArray[np.bool_]]:
    """Part scenes into folds, at most as many as there are rooms; a room is never parted.

    Args:
        rooms: that of each scene.
    """
    names, room = np.unique(np.asarray(rooms), return_inverse=True)
    count = min(FOLDS, len(names))
    number = (np.random.default_rng(0).permutation(len(names)) % count)[room]
    return [number == fold for fold in range(count)]
