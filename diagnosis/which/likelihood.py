"""How likely a gap is, given what effects would make of the features."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from starling.diagnosis.which.predicted import Made
from starling.diagnosis.which.response import Signature
from starling.diagnosis.which.table import Table

FREEDOM = 4.0  # Of Student's t: a feature that the simulator gets wrong must not decide alone.
TAU = 0.2  # Share of its own size by which what effects make is taken to be wrong.
LARGEST = 100.0  # Squared deviations of one feature that count for a gap's size.
_SEEN = 1.0  # Deviations, root sum of squares, below which a change tells of no likeness.


@dataclass(frozen=True, slots=True, eq=False)
class Likelihood:
    """A gap, the deviation of each feature, and how much each tells that others do not."""

    gap: Table  # (scenes, features) real less simulated; NaN where it is not known.
    deviation: Table  # Likewise: noise of both, and what is put down to the simulator.
    weight: NDArray[np.float64]  # (features,) as of `weights`.

    @property
    def nothing(self) -> Made:
        """What no effect makes: zeros."""
        return Made(np.zeros_like(self.gap))

    def left(self, made: Made) -> Table:
        """What effects leave of the gap, over its deviation (scenes, features)."""
        return (self.gap - made.change) / self.deviation

    def size(self, made: Made) -> float:
        """Weighted mean square of `left`.

        The deviation holds what the simulator gets wrong too: chance alone makes less than 1.

        Args:
            made: what effects make.
        """
        return total(self.left(made), self.weight)

    def sizes(self, made: Made) -> NDArray[np.float64]:
        """The same for each scene (scenes,)."""
        return by_scene(self.left(made), self.weight)

    def beyond(self, made: Made) -> Table:
        """What effects leave, over a deviation that holds what they themselves are wrong by.

        No measure of how far a gap closes: the more effects make, the more they may be wrong by.
        """
        return (self.gap - made.change) / np.sqrt(self._variance(made))

    def cost(self, made: Made) -> NDArray[np.float64]:
        """Negative logarithm of the likelihood for each scene.

        Beyond what counts for a gap's size a distance is told without what an effect may be wrong
        by itself: else one that changes such a feature a little, either way, would gain by being
        less sure of it.

        Args:
            made: what effects make.

        Returns:
            (..., scenes), up to a constant.
        """
        variance, left = self._variance(made), self.gap - made.change
        wide = 0.5 * np.log(variance / self.deviation**2)
        near = np.log1p(squares(left / np.sqrt(variance)) / FREEDOM)
        far = np.log(np.maximum((left / self.deviation) ** 2 / LARGEST, 1.0))
        off = 0.5 * (FREEDOM + 1) * (near + far)
        return np.where(np.isfinite(self.gap), off + wide, 0.0) @ self.weight

    def _variance(self, made: Made) -> NDArray[np.float64]:
        return self.deviation**2 + (TAU * made.change) ** 2 + made.scatter


def by_scene(left: Table, weight: NDArray[np.float64]) -> NDArray[np.float64]:
    """Size (scenes,) of a gap in each scene.

    Args:
        left: (scenes, features) what there is or what effects leave of it, over its deviation; NaN
            where not known.
        weight: (features,) votes.
    """
    return squares(left) @ weight / np.maximum(np.isfinite(left) @ weight, 1e-9)


def total(left: Table, weight: NDArray[np.float64]) -> float:
    """Size of a gap in all scenes (arguments as `by_scene`)."""
    votes = max(float((np.isfinite(left) @ weight).sum()), 1e-9)
    return float((squares(left) @ weight).sum() / votes)


def squares(left: Table) -> Table:
    """As they count for a size: 0 where not known, none beyond `LARGEST`."""
    return np.minimum(np.nan_to_num(left) ** 2, LARGEST)


def directions(
    signatures: Sequence[Signature], deviation: Table
) -> tuple[list[Signature], NDArray[np.float64]]:
    """Which way effects move features: what each makes over its deviation, of length 1.

    Args:
        signatures: of the effects, one at least.
        deviation: of each scene's features.

    Returns:
        By change that can be seen, whose it is, and its direction (changes, scenes, features).
    """
    owners = [one for one in signatures for _ in one.values]
    moves = np.concatenate([one.change for one in signatures]) / deviation
    size = np.sqrt((moves**2).sum(axis=(1, 2)))
    seen = np.flatnonzero(size > _SEEN)
    return [owners[number] for number in seen], moves[seen] / size[seen, None, None]


def weights(signatures: Sequence[Signature], deviation: Table) -> NDArray[np.float64]:
    """Share of each feature that others do not repeat: 1 over its squared likenesses to all.

    Features that whatever is done move alike, such as the sharpness of ten parts of one image, tell
    one thing ten times, and are wrong together where the simulator is wrong. Without this they
    outvote a single feature that knows better.

    Args:
        signatures: what many effects do; where there are none every feature has a vote.
        deviation: of each scene's features.

    Returns:
        (features,) in 0..1.
    """
    if not signatures:
        return np.ones(deviation.shape[-1])
    rows = directions(signatures, deviation)[1].reshape(-1, deviation.shape[-1])
    product = rows.T @ rows
    length = np.sqrt(np.diag(product))
    still = length < 1e-6  # No effect moves it.
    length[still] = 1.0
    likeness = product / np.outer(length, length)
    likeness[still, still] = 1.0
    return 1 / (likeness**2).sum(axis=1)
