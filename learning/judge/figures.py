"""How well held-out scores separate real from simulated windows, with intervals over rooms."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from starling.sim.randomness import generator

_DRAWS = 4000  # Draws of the bootstrap, and of the permutation test.
_LEVEL = 0.95  # Confidence level.
_ROUNDING = 1e-12  # Areas closer than this are equal.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class RoomScores:
    """Held-out scores of one room's windows."""

    room: str
    real: NDArray[np.float64]
    sim: NDArray[np.float64]


def auc(real: NDArray[np.floating], sim: NDArray[np.floating]) -> float:
    """Probability that a real window scores above a simulated one; ties count one half."""
    if not len(real) or not len(sim):
        return math.nan
    return _above(real, sim) / (len(real) * len(sim))


def pooled_auc(rooms: Sequence[RoomScores]) -> float:
    """Area under the ROC curve of all rooms' windows together."""
    return auc(*(np.concatenate([getattr(room, s) for room in rooms]) for s in ("real", "sim")))


def interval(rooms: Sequence[RoomScores], seed: int) -> tuple[float, float]:
    """95 % interval of the pooled area by resampling whole rooms.

    Percentiles are widened to those of Student's distribution, as few rooms ask for (Hesterberg,
    The American Statistician 69, 2015).
    """
    random = generator(seed, 0, "judge", "bootstrap")
    count = len(rooms)
    drawn = random.integers(count, size=(_DRAWS, count))
    times = (drawn[:, :, None] == np.arange(count)).sum(axis=1).astype(float)
    wins, sizes = _wins(rooms)
    above = ((times @ wins[:count, count:]) * times).sum(axis=1)
    areas = above / ((times @ sizes[:count]) * (times @ sizes[count:]))
    reach = stats.t.ppf(0.5 + _LEVEL / 2, count - 1) * math.sqrt(count / (count - 1))
    tail = float(stats.norm.sf(reach))
    low, high = np.quantile(areas, (tail, 1 - tail))
    return float(low), float(high)


def p_value(rooms: Sequence[RoomScores], seed: int) -> float:
    """Chance of an area at least this far from 0.5 if real and simulated are exchangeable.

    The sides of whole rooms are swapped at random (permutation test).
    """
    random = generator(seed, 0, "judge", "permutation")
    count = len(rooms)
    swapped = random.integers(2, size=(_DRAWS, count))
    swapped[0] = 0  # The observed one counts.
    wins, sizes = _wins(rooms)
    first = np.arange(count) + swapped * count
    second = np.arange(count) + (1 - swapped) * count
    above = wins[first[:, :, None], second[:, None, :]].sum(axis=(1, 2))
    distance = np.abs(above / (sizes[first].sum(axis=1) * sizes[second].sum(axis=1)) - 0.5)
    return float((distance >= distance[0] - _ROUNDING).mean())


def _wins(rooms: Sequence[RoomScores]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Count pairs of windows whose first scores higher, by sides of rooms, and all windows.

    Returns:
        (2 n, 2 n) and (2 n,): real sides of the n rooms, then simulated ones.
    """
    groups = [room.real for room in rooms] + [room.sim for room in rooms]
    wins = np.array([[_above(first, second) for second in groups] for first in groups])
    return wins, np.array([float(len(group)) for group in groups])


def _above(first: NDArray[np.floating], second: NDArray[np.floating]) -> float:
    ordered = np.sort(second)
    below = np.searchsorted(ordered, first, "left") + np.searchsorted(ordered, first, "right")
    return float(below.sum()) / 2


def summary(rooms: Sequence[RoomScores], seed: int) -> dict[str, Any]:
    """Return `auc`, its `interval`, `p_value`, and `rooms` with each room's area."""
    return {
        "auc": pooled_auc(rooms),
        "interval": list(interval(rooms, seed)),
        "p_value": p_value(rooms, seed),
        "rooms": {room.room: auc(room.real, room.sim) for room in rooms},
        "windows": sum(len(room.real) for room in rooms),
    }
