"""Bootstrap over rooms: scenes of one room are not independent, so rooms are resampled."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from starling.sim.arrays import mean_known

FEWEST = 3  # Rooms below which no interval is computed.
LEVEL = 0.95  # Confidence level of intervals.


def room_means(values: NDArray[np.float64], rooms: Sequence[str]) -> NDArray[np.float64]:
    """Average over the scenes of each room.

    Args:
        values: (scenes, ...); NaN where unknown.
        rooms: room of each scene.

    Returns:
        (rooms, ...), rooms in order of first appearance; NaN where nothing is known.
    """
    number = _room_numbers(rooms)
    return np.stack([mean_known(values[number == room], 0) for room in range(number.max() + 1)])


def resample_rooms(rooms: Sequence[str], count: int, rng: np.random.Generator) -> NDArray[np.int64]:
    """Draw rooms with replacement.

    Args:
        rooms: room of each scene.
        count: number of resamples.
        rng: generator of the draws.

    Returns:
        (count, scenes) how often each scene occurs in each resample.
    """
    number = _room_numbers(rooms)
    room_count = number.max() + 1
    drawn = rng.multinomial(room_count, np.full(room_count, 1 / room_count), size=count)
    return drawn[:, number]


def interval(
    resampled: NDArray[np.float64],
    estimate: NDArray[np.float64] | float,
    count: NDArray[np.int64] | int,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Compute percentiles of a bootstrap over rooms, widened for small samples.

    Percentile intervals of a mean of n rooms are too narrow by sqrt((n - 1) / n). They are also too
    narrow by the ratio of Student's t to the normal quantile. With three rooms, nominal 95 % cover
    75 %. The distances from the estimate are stretched by both factors.

    Args:
        resampled: (resamples, ...) statistic of each resample; NaN where undefined.
        estimate: (...) statistic of the original sample.
        count: (...) number of rooms; below `FEWEST` the interval is NaN.

    Returns:
        Lower and upper ends (...).

    Source: Hesterberg, What teachers should know about the bootstrap, Am. Stat. 69 (2015), 4.2.
    """
    tail = (1 - LEVEL) / 2
    low, high = np.nanquantile(resampled, (tail, 1 - tail), axis=0)
    size = np.maximum(np.asarray(count, float), 2)
    widening = np.sqrt(size / (size - 1)) * stats.t.isf(tail, size - 1) / stats.norm.isf(tail)
    widening = np.where(np.asarray(count) < FEWEST, np.nan, widening)
    return estimate + widening * (low - estimate), estimate + widening * (high - estimate)


def mean_interval(
    values: NDArray[np.float64], times: NDArray[np.int64], count: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Compute the `interval` of a mean over scenes.

    Args:
        values: (scenes,), all known.
        times: (resamples, scenes) from `resample_rooms`.
        count: number of rooms.
    """
    return interval(times @ values / times.sum(axis=1), float(values.mean()), count)


def _room_numbers(rooms: Sequence[str]) -> NDArray[np.intp]:
    """Number the rooms in order of first appearance; return each scene's number."""
    order = list(dict.fromkeys(rooms))
    return np.array([order.index(room) for room in rooms])
