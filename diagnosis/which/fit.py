"""Fit of one effect's strength to a gap, scored on held-out scenes."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from starling.diagnosis.scenes.rooms import resample_rooms
from starling.diagnosis.which.likelihood import Likelihood
from starling.diagnosis.which.response import PredictedChange, Signature, stack_changes
from starling.sim.effects.effect import Value

FOLDS = 4
_STEPS = 16  # Positions tried between two nodes.
_DRAWS = 400  # Bootstrap resamples of rooms.

Folds = Sequence[NDArray[np.bool_]]


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """Best strength of a candidate, and its held-out gain."""

    signature: Signature
    place: float  # Position of the best strength (see `Signature`).
    gain: NDArray[np.float64]  # (scenes,) gain in log-likelihood, each scene held out.
    cost: NDArray[np.float64]  # (places, scenes) negative log-likelihood.
    places: NDArray[np.float64]  # Tried positions.

    @property
    def name(self) -> str:
        """Name of the candidate."""
        return self.signature.name

    @property
    def value(self) -> Value:
        """Best value of the parameter."""
        return self.signature.value(self.place)

    @property
    def total(self) -> float:
        """Held-out gain of all scenes."""
        return float(self.gain.sum())

    def interval(self, rooms: Sequence[str], *, level: float) -> tuple[Value, Value]:
        """Compute an interval of the value, from a bootstrap over rooms and from the likelihood.

        Model error is the same in every scene, so all scenes together count as one. The likelihood
        interval therefore uses the mean over scenes, which may fall by half of chi-square's
        quantile. The result covers both intervals.

        Args:
            rooms: room of each scene.
            level: confidence level.

        Returns:
            Lower and upper end. For a choice, the first and last of the values between the ends.
        """
        times = resample_rooms(rooms, _DRAWS, np.random.default_rng(0))
        best = self.places[np.argmin(self.cost @ times.T, axis=0)]
        ends = ((1 - level) / 2, (1 + level) / 2)
        numeric = self.signature.candidate.numeric
        low, high = np.quantile(best, ends, method="linear" if numeric else "nearest")
        mean = self.cost.mean(axis=1)
        near = self.places[mean <= mean.min() + 0.5 * stats.chi2.ppf(level, 1)]
        continuous = numeric and not self.signature.candidate.whole
        half_a_step = 0.5 * float(self.places[1] - self.places[0]) if continuous else 0.0
        low = max(min(low, near[0]) - half_a_step, self.places[0])
        high = min(max(high, near[-1]) + half_a_step, self.places[-1])
        if numeric:
            return self.signature.value(float(low)), self.signature.value(float(high))
        between = self.signature.values[int(low) : int(high) + 1]
        if any(isinstance(value, str) for value in between):
            return between[0], between[-1]
        return min(between, key=float), max(between, key=float)


def fit(
    signature: Signature,
    likelihood: Likelihood,
    folds: Folds,
    *,
    background: PredictedChange | None = None,
    reference: PredictedChange | None = None,
    steps: int = _STEPS,
) -> Fit:
    """Fit a candidate to all scenes, and score it by cross-validation over folds.

    Args:
        signature: signature of the candidate.
        likelihood: likelihood of the gap.
        folds: masks (scenes,) of the scenes held out in each fold.
        background: change by other effects that act together with the candidate; None: no effects.
        reference: change by the other effects without the candidate, from which the gain counts;
            None takes `background`.
        steps: positions tried between two nodes.
    """
    background = likelihood.no_change if background is None else background
    tried = places(signature, steps)
    cost = likelihood.cost(
        stack_changes([background + signature.change_at(place) for place in tried])
    )
    without = likelihood.cost(background if reference is None else reference)
    gain = held_out_gain(cost, without, folds)
    return Fit(signature, float(tried[int(np.argmin(cost.sum(axis=1)))]), gain, cost, tried)


def held_out_gain(
    cost: NDArray[np.float64],
    without: NDArray[np.float64],
    folds: Folds,
) -> NDArray[np.float64]:
    """Compute the gain (scenes,) of the choice that is best in the other folds.

    Args:
        cost: (choices, scenes).
        without: (scenes,) cost without the effect.
        folds: masks (scenes,).
    """
    gain = np.zeros_like(without)
    for held_out in folds:
        best = int(np.argmin(cost[:, ~held_out].sum(axis=1)))
        gain[held_out] = (without - cost[best])[held_out]
    return gain


def places(signature: Signature, steps: int) -> NDArray[np.float64]:
    """List the positions to try, from the first value to the last.

    For a choice these are its values. For an integer parameter they are the positions of integers.

    Args:
        signature: signature of a candidate.
        steps: positions from one value to the next.
    """
    last = len(signature.values) - 1
    if signature.candidate.whole:
        values = np.array(signature.values, float)
        between = [np.rint(np.linspace(*ends, steps + 1)) for ends in itertools.pairwise(values)]
        return np.interp(np.unique(between), values, np.arange(last + 1))
    return np.linspace(0, last, (last * steps if signature.candidate.numeric else last) + 1)


def room_folds(rooms: Sequence[str]) -> list[NDArray[np.bool_]]:
    """Divide scenes into at most `FOLDS` folds; all scenes of a room are in one fold.

    Args:
        rooms: room of each scene.
    """
    names, room = np.unique(np.asarray(rooms), return_inverse=True)
    count = min(FOLDS, len(names))
    number = (np.random.default_rng(0).permutation(len(names)) % count)[room]
    return [number == fold for fold in range(count)]
