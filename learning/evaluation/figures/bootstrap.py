"""How sure a difference of two methods is, when what was drawn is rooms, not pixels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from starling.patterns import errors
from starling.sim.randomness import generator

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


@dataclass(frozen=True, kw_only=True, slots=True)
class Share:
    """What share of one method's mean over rooms another takes away, with its 95 % interval."""

    share: float
    low: float
    high: float
    rooms: int
    less: int  # Rooms in which it takes something away.


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
    one, other = _by_room(first, second, room)
    rooms = one - other
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
    """Bootstrap 1 less the mean over rooms of `second` over that of `first`, drawing whole rooms.

    Both means are drawn together: how hard the rooms are, which both methods share, cancels. As for
    `paired_difference` percentiles are moved outwards.

    Args:
        first: a figure of each scene (or room) by one method, none below 0.
        second: the same figure of the same scenes by another.
        room: the room of each.
        seed: fixes the 10 000 draws.

    Raises:
        InputError: as `paired_difference`, or if the first has a room below or at 0.
    """
    one, other = _by_room(first, second, room)
    if not (one > 0).all():
        rule, advice = "must be > 0 in every room", "Leave out rooms without an error."
        raise errors.refuse("first", rule, one.min(), advice)
    count = len(one)
    drawn = _draws(count, seed)
    low, high = _ends(1 - other[drawn].mean(axis=1) / one[drawn].mean(axis=1), count)
    return Share(
        share=float(1 - other.mean() / one.mean()),
        low=low,
        high=high,
        rooms=count,
        less=int(np.count_nonzero(other < one)),
    )


def _by_room(
    first: Sequence[float], second: Sequence[float], room: Sequence[str]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Means of both figures in each room."""
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
        raise errors.refuse("rooms", "must be at least 2", len(names), "One room tells no spread.")
    scenes = np.bincount(member)
    one, other = (np.bincount(member, each) / scenes for each in both)
    return one, other


def _draws(count: int, seed: int) -> NDArray[np.int64]:
    """Rooms of each draw (draws, rooms)."""
    rng = generator(seed, 0, "learning", "bootstrap")
    return rng.integers(0, count, (_DRAWS, count))


def _ends(drawn: NDArray[np.float64], count: int) -> tuple[float, float]:
    """The interval of what was drawn of so many rooms."""
    tail = (1 - _LEVEL) / 2
    wider = stats.norm.cdf(np.sqrt(count / (count - 1)) * stats.t.ppf(tail, count - 1))
    low, high = np.quantile(drawn, [wider, 1 - wider])
    return float(low), float(high)
