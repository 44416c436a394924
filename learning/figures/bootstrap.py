"""How sure a difference of two methods is, when what was drawn is rooms, not pixels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from patterns import errors
from sim.randomness import generator

_LEVEL = 0.95
_DRAWS = 10_000


@dataclass(frozen=True, kw_only=True, slots=True)
class Difference:
    """Mean difference over rooms, with its 95 % interval."""

    mean: float
    low: float
    high: float
    rooms: int
    above: int  # Rooms whose own difference is above 0.

    @property
    def excludes_zero(self) -> bool:
        """Whether the interval lies on one side of 0."""
        return self.low > 0 or self.high < 0


def paired_difference(
    first: Sequence[float], second: Sequence[float], room: Sequence[str], *, seed: int
) -> Difference:
    """Bootstrap the mean over rooms of `first - second`, drawing whole rooms.

    Scenes of one room are no independent evidence, so they are averaged first and drawn together
    (cluster bootstrap; Davison and Hinkley, Bootstrap Methods and their Application, 1997, sec.
    3.8). With few rooms a plain percentile interval is too narrow, by the variance's n - 1 over n
    and by the normal's lighter tails: its percentiles are moved outwards to Student's (the expanded
    percentile interval; Hesterberg, What Teachers Should Know About the Bootstrap, The American
    Statistician 69, 2015). No interval from n rooms knows of a kind of room not among them.

    Args:
        first: a figure of each scene (or room) by one method.
        second: the same figure of the same scenes by another.
        room: the room of each.
        seed: fixes the 10 000 draws.

    Raises:
        InputError: if the lengths differ, a figure is no finite number, or there are fewer than
            two rooms.
    """
    if not len(first) == len(second) == len(room):
        raise errors.refuse(
            "first, second and room",
            "must be equally long",
            f"{len(first)}, {len(second)} and {len(room)}",
            "Give both methods' figures of the same scenes.",
        )
    difference = np.asarray(first, np.float64) - np.asarray(second, np.float64)
    if not np.isfinite(difference).all():
        raise errors.refuse(
            "figures",
            "must be finite",
            f"{np.count_nonzero(~np.isfinite(difference))} that are not",
            "Leave out what could not be measured, in both methods.",
        )
    names, member = np.unique(np.asarray(room, str), return_inverse=True)
    count = len(names)
    if count < 2:
        raise errors.refuse("rooms", "must be at least 2", count, "One room tells no spread.")
    rooms = np.bincount(member, difference) / np.bincount(member)
    drawn = generator(seed, 0, "learning", "bootstrap").integers(0, count, (_DRAWS, count))
    tail = (1 - _LEVEL) / 2
    wider = stats.norm.cdf(np.sqrt(count / (count - 1)) * stats.t.ppf(tail, count - 1))
    low, high = np.quantile(rooms[drawn].mean(axis=1), [wider, 1 - wider])
    return Difference(
        mean=float(rooms.mean()),
        low=float(low),
        high=float(high),
        rooms=count,
        above=int(np.count_nonzero(rooms > 0)),
    )
