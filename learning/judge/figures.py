"""How well held-out scores tell real from simulated windows, with intervals over rooms."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from starling.sim.randomness import generator

_DRAWS = 2000  # Draws of the bootstrap, and of the permutation test.
_LEVEL = 0.95


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
    ranks = stats.rankdata(np.concatenate([real, sim]))
    above = ranks[: len(real)].sum() - len(real) * (len(real) + 1) / 2
    return float(above / (len(real) * len(sim)))


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
    areas = [pooled_auc([rooms[number] for number in row]) for row in drawn]
    reach = stats.t.ppf(0.5 + _LEVEL / 2, count - 1) * math.sqrt(count / (count - 1))
    tail = float(stats.norm.sf(reach))
    low, high = np.quantile(areas, (tail, 1 - tail))
    return float(low), float(high)


def p_value(rooms: Sequence[RoomScores], seed: int) -> float:
    """Chance of an area at least this far from 0.5 if real and simulated are exchangeable.

    The sides of whole rooms are swapped at random (permutation test).
    """
    random = generator(seed, 0, "judge", "permutation")
    reached = abs(pooled_auc(rooms) - 0.5)
    count = 0
    for swaps in random.random((_DRAWS, len(rooms))) < 0.5:
        swapped = [
            RoomScores(room=room.room, real=room.sim, sim=room.real) if swap else room
            for swap, room in zip(swaps, rooms, strict=True)
        ]
        count += abs(pooled_auc(swapped) - 0.5) >= reached - 1e-12
    return (count + 1) / (_DRAWS + 1)


def summary(rooms: Sequence[RoomScores], seed: int) -> dict[str, object]:
    """Return `auc`, its `interval`, `p_value`, and `rooms` with each room's area."""
    return {
        "auc": pooled_auc(rooms),
        "interval": list(interval(rooms, seed)),
        "p_value": p_value(rooms, seed),
        "rooms": {room.room: auc(room.real, room.sim) for room in rooms},
        "windows": sum(len(room.real) for room in rooms),
    }
