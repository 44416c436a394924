"""Share of the closable gap that is closed: before less after, over before less floor."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from starling.diagnosis.scenes.rooms import FEWEST, draws, interval, mean_interval

_DRAWS = 2000


@dataclass(frozen=True, kw_only=True, slots=True)
class Closed:
    """One figure, means over scenes."""

    before: float
    after: float
    floor: float
    closed_pct: float | None  # Ratio of sums over scenes; None where nothing can be closed.
    interval: tuple[float, float] | None  # 95 %, over rooms; None of few.


def closed(
    before: Sequence[Mapping[str, float]],
    after: Sequence[Mapping[str, float]],
    floor: Sequence[Mapping[str, float]],
    rooms: Sequence[str],
) -> dict[str, Closed]:
    """Compare three sets of distances, scene by scene.

    Args:
        before: by figure, of each scene that has it, with the base.
        after: with the accepted effects.
        floor: of two simulated readings, by two devices of the kind.
        rooms: of the scenes.

    Returns:
        By figure. A gap whose 95 % interval over rooms reaches down to the floor is none: not
        identifiable. Of fewer than three rooms every scene must have it, and there is no interval.
    """
    found = {}
    for name in dict.fromkeys(name for one in before for name in one):
        columns = [
            np.array([one.get(name, np.nan) for one in many], float)
            for many in (before, after, floor)
        ]
        known = np.all([np.isfinite(column) for column in columns], axis=0)
        if known.any():
            of = [room for room, told in zip(rooms, known, strict=True) if told]
            one, other, least = (column[known] for column in columns)
            found[name] = _closed(one, other, least, of)
    return found


def _closed(before: NDArray, after: NDArray, floor: NDArray, rooms: Sequence[str]) -> Closed:
    times = draws(rooms, _DRAWS, np.random.default_rng(0))
    count = len(set(rooms))
    share, ends = None, None
    if count >= FEWEST:
        least = float(mean_interval(before - floor, times, count)[0])
    else:
        least = float((before - floor).min())
    if least > 0:
        share = float(100 * (before - after).sum() / (before - floor).sum())
    if share is not None and count >= FEWEST:
        gap = times @ (before - floor)
        gap = np.where(gap > 0, gap, np.nan)  # The few draws without one have no share.
        low, high = interval(100 * (times @ (before - after)) / gap, share, count)
        ends = (float(low), float(high))
    return Closed(
        before=float(before.mean()),
        after=float(after.mean()),
        floor=float(floor.mean()),
        closed_pct=share,
        interval=ends,
    )
