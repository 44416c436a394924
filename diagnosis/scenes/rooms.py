"""Scenes of one room are no independent evidence: rooms are what is drawn anew."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from starling.sim.statistics import mean_known

FEWEST = 3  # Rooms below which nothing is said of how sure a mean is.
LEVEL = 0.95  # Of intervals.


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


def interval(
    drawn: NDArray[np.float64],
    middle: NDArray[np.float64] | float,
    count: NDArray[np.int64] | int,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Percentiles of a bootstrap over rooms, widened to what so few of them can tell.

    Percentiles of means of n rooms are too narrow by sqrt((n - 1) / n), and by what Student's t has
    beyond the normal law: of three rooms 95 % cover 75 %. Their distances from the middle are
    stretched by both.

    Args:
        drawn: (draws, ...) what rooms drawn anew give; NaN of draws that tell nothing.
        middle: (...) what the rooms themselves give.
        count: (...) of the rooms; fewer than `FEWEST` tell nothing, which is NaN.

    Returns:
        Both ends (...).

    Source: Hesterberg, What teachers should know about the bootstrap, Am. Stat. 69 (2015), 4.2.
    """
    tail = (1 - LEVEL) / 2
    low, high = np.nanquantile(drawn, (tail, 1 - tail), axis=0)
    many = np.maximum(np.asarray(count, float), 2)
    wider = np.sqrt(many / (many - 1)) * stats.t.isf(tail, many - 1) / stats.norm.isf(tail)
    wider = np.where(np.asarray(count) < FEWEST, np.nan, wider)
    return middle + wider * (low - middle), middle + wider * (high - middle)


def mean_interval(
    values: NDArray[np.float64], times: NDArray[np.int64], count: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Both ends of the `interval` of a mean over scenes.

    Args:
        values: (scenes,), all known.
        times: (draws, scenes) as of `draws`.
        count: of the rooms.
    """
    return interval(times @ values / times.sum(axis=1), float(values.mean()), count)


def _numbers(rooms: Sequence[str]) -> NDArray[np.intp]:
    """Number of each scene's room, in the order rooms come in."""
    order = list(dict.fromkeys(rooms))
    return np.array([order.index(room) for room in rooms])
