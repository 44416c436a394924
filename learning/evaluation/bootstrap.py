"""Intervals of the difference of two methods by a bootstrap over rooms."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from starling.patterns import errors
from starling.sim.randomness import generator

_LEVEL = 0.95  # Confidence level.
_DRAWS = 10_000  # Bootstrap draws.


@dataclass(frozen=True, kw_only=True, slots=True)
class Difference:
    """Mean difference over rooms, with its 95 % interval."""

    mean: float
    low: float
    high: float
    rooms: int
    above: int  # Rooms with a difference above 0.


@dataclass(frozen=True, kw_only=True, slots=True)
class Share:
    """Relative reduction of one method's mean over rooms by another, with its 95 % interval."""

    share: float
    low: float
    high: float
    rooms: int
    less: int  # Rooms in which the second method is lower.


def paired_difference(
    first: Sequence[float], second: Sequence[float], room: Sequence[str], *, seed: int
) -> Difference:
    """Bootstrap the mean over rooms of `first - second` by resampling whole rooms.

    Scenes of one room are not independent, so that they are averaged first and resampled together
    (cluster bootstrap; Davison and Hinkley, Bootstrap Methods and their Application, 1997, sec.
    3.8). With few rooms the percentile interval is too narrow. Its variance is too small by (n -
    1) / n and it has the tails of a normal distribution. The percentiles are therefore widened to
    those of Student's distribution (expanded percentile interval; Hesterberg, What Teachers Should
    Know About the Bootstrap, The American Statistician 69, 2015). The interval does not cover kinds
    of rooms that are not among the n rooms.

    Args:
        first: a metric of each scene (or room) by one method.
        second: the same metric of the same scenes by another method.
        room: room of each scene.
        seed: seed of the 10 000 draws.

    Raises:
        InputError: if the lengths differ, a value is not finite, or there are fewer than two rooms.
    """
    first_means, second_means = _by_room(first, second, room)
    rooms = first_means - second_means
    count = len(rooms)
    low, high = _ends(rooms[_draws(count, seed)].mean(axis=1), count)
    return Difference(
        mean=float(rooms.mean()),
        low=low,
        high=high,
        rooms=count,
        above=int(np.count_nonzero(rooms > 0)),
    )


def paired_share(
    first: Sequence[float], second: Sequence[float], room: Sequence[str], *, seed: int
) -> Share:
    """Bootstrap 1 less the ratio of the means over rooms, `second` over `first`.

    Whole rooms are resampled. Both means are resampled together, so that the common difficulty of
    rooms cancels. Percentiles are widened as for `paired_difference`.

    Args:
        first: a metric of each scene (or room) by one method, not below 0.
        second: the same metric of the same scenes by another method.
        room: room of each scene.
        seed: seed of the 10 000 draws.

    Raises:
        InputError: see `paired_difference`; or if the first has a room at or below 0.
    """
    first_means, second_means = _by_room(first, second, room)
    if not (first_means > 0).all():
        rule, advice = "must be > 0 in every room", "Leave out rooms without an error."
        raise errors.refuse("first", rule, first_means.min(), advice)
    count = len(first_means)
    drawn = _draws(count, seed)
    low, high = _ends(1 - second_means[drawn].mean(axis=1) / first_means[drawn].mean(axis=1), count)
    return Share(
        share=float(1 - second_means.mean() / first_means.mean()),
        low=low,
        high=high,
        rooms=count,
        less=int(np.count_nonzero(second_means < first_means)),
    )


def _by_room(
    first: Sequence[float], second: Sequence[float], room: Sequence[str]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Mean of both metrics in each room."""
    if not len(first) == len(second) == len(room):
        raise errors.refuse(
            "first, second and room",
            "must be equally long",
            f"{len(first)}, {len(second)} and {len(room)}",
            "Give both methods' figures of the same scenes.",
        )
    both = np.array([first, second], np.float64)
    if not np.isfinite(both).all():
        raise errors.refuse(
            "figures",
            "must be finite",
            f"{np.count_nonzero(~np.isfinite(both).all(axis=0))} that are not",
            "Leave out what could not be measured, in both methods.",
        )
    names, member = np.unique(np.asarray(room, str), return_inverse=True)
    if len(names) < 2:
        raise errors.refuse("rooms", "must be at least 2", len(names), "One room has no spread.")
    scenes = np.bincount(member)
    first_means, second_means = (np.bincount(member, each) / scenes for each in both)
    return first_means, second_means


def _draws(count: int, seed: int) -> NDArray[np.int64]:
    """Resampled rooms (draws, rooms)."""
    rng = generator(seed, 0, "learning", "bootstrap")
    return rng.integers(0, count, (_DRAWS, count))


def _ends(drawn: NDArray[np.float64], count: int) -> tuple[float, float]:
    """Ends of the interval from the bootstrap distribution over `count` rooms."""
    tail = (1 - _LEVEL) / 2
    tail_share = stats.norm.cdf(np.sqrt(count / (count - 1)) * stats.t.ppf(tail, count - 1))
    low, high = np.quantile(drawn, [tail_share, 1 - tail_share])
    return float(low), float(high)
