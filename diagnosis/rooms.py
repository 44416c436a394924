"""Scenes of one room are no independent evidence: rooms are what is drawn anew."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sim.statistics import mean_known

FEWEST = 3  # Rooms below which nothing is said of how sure a mean is.


def means(values: NDArray[np.float64], rooms: Sequence[str]) -> NDArray[np.float64]:
    """Mean of each room's scenes.

    Args:
        values: (scenes, ...); NaN where not known.
        rooms: that of each scene.

    Returns:
        (rooms, ...), rooms in the order they come in; NaN where nothing is known.
    """
    number = _numbers(rooms)
    return np.stack([mean_known(values[number == room], 0) for room in range(number.max() + 1)])


def draws(rooms: Sequence[str], count: int, rng: np.random.Generator) -> NDArray[np.int64]:
    """How often each scene comes (count, scenes), as many rooms as there are being drawn anew.

    Args:
        rooms: that of each scene.
        count: of draws.
        rng: draws.
    """
    number = _numbers(rooms)
    many = number.max() + 1
    return rng.multinomial(many, np.full(many, 1 / many), size=count)[:, number]


def _numbers(rooms: Sequence[str]) -> NDArray[np.intp]:
    """Number of each scene's room, in the order rooms come in."""
    order = list(dict.fromkeys(rooms))
    return np.array([order.index(room) for room in rooms])
