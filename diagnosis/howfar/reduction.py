"""Gap reduction: (before - after) / (before - noise floor)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from starling.diagnosis.scenes.rooms import FEWEST, interval, mean_interval, resample_rooms

_DRAWS = 2000


@dataclass(frozen=True, kw_only=True, slots=True)
class GapReduction:
    """One figure before and after, mean over scenes."""

    before: float
    after: float
    floor: float  # Noise floor.
    closed_pct: float | None  # Ratio of sums over scenes [%]; None if not identifiable.
    interval: tuple[float, float] | None  # 95 %, over rooms; None with fewer than three.


def gap_reductions(
    before: Sequence[Mapping[str, float]],
    after: Sequence[Mapping[str, float]],
    floor: Sequence[Mapping[str, float]],
    rooms: Sequence[str],
) -> dict[str, GapReduction]:
    """Compute the gap reduction of each figure from distances per scene.

    Args:
        before: figures of each scene with the base; scenes may lack figures.
        after: figures with the accepted effects.
        floor: figures between simulated captures by two devices of the same model.
        rooms: room of each scene.

    Returns:
        Reduction by figure. It is not identifiable if the 95 % interval of before - floor over
        rooms includes zero. With fewer than three rooms, before must exceed the floor in every
        scene, and there is no interval.
    """
    reductions = {}
    for name in dict.fromkeys(name for figures in before for name in figures):
        columns = [
            np.array([figures.get(name, np.nan) for figures in scenes], float)
            for scenes in (before, after, floor)
        ]
        known = np.all([np.isfinite(column) for column in columns], axis=0)
        if known.any():
            known_rooms = [room for room, is_known in zip(rooms, known, strict=True) if is_known]
            known_before, known_after, known_floor = (column[known] for column in columns)
            reductions[name] = _reduction(known_before, known_after, known_floor, known_rooms)
    return reductions


def _reduction(
    before: NDArray, after: NDArray, floor: NDArray, rooms: Sequence[str]
) -> GapReduction:
    times = resample_rooms(rooms, _DRAWS, np.random.default_rng(0))
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
        gap = np.where(gap > 0, gap, np.nan)  # Samples without a gap have no reduction.
        low, high = interval(100 * (times @ (before - after)) / gap, share, count)
        ends = (float(low), float(high))
    return GapReduction(
        before=float(before.mean()),
        after=float(after.mean()),
        floor=float(floor.mean()),
        closed_pct=share,
        interval=ends,
    )
