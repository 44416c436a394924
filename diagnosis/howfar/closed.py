"""Share of the closable gap that is closed: before less after, over before less floor."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_LEVEL = 0.95
_DRAWS = 2000


@dataclass(frozen=True, kw_only=True, slots=True)
class Closed:
    """One figure, means over scenes."""

    before: float
    after: float
    floor: float
    closed_pct: float | None  # Ratio of sums over scenes; None where nothing can be closed.
    interval: tuple[float, float] | None  # 95 %, bootstrap over scenes; None of one scene.


def closed(
    before: Sequence[Mapping[str, float]],
    after: Sequence[Mapping[str, float]],
    floor: Sequence[Mapping[str, float]],
    *,
    seed: int = 0,
) -> dict[str, Closed]:
    """Compare three sets of distances, scene by scene.

    Args:
        before: by figure, of each scene, with the base.
        after: with the accepted effects.
        floor: of two readings that differ by noise alone.
        seed: of the bootstrap.

    Returns:
        By figure. A gap whose interval of before less floor holds 0 is no gap: not identifiable.
    """
    found = {}
    for name in before[0]:
        columns = [np.array([one[name] for one in many], float) for many in (before, after, floor)]
        known = np.all([np.isfinite(column) for column in columns], axis=0)
        if known.any():
            found[name] = _closed(*(column[known] for column in columns), seed=seed)
    return found


def _closed(before: NDArray, after: NDArray, floor: NDArray, *, seed: int) -> Closed:
    rng = np.random.default_rng(seed)
    drawn = rng.integers(len(before), size=(_DRAWS, len(before)))
    closable = (before - floor)[drawn].sum(axis=1)
    tail = (1 - _LEVEL) / 2
    share, interval = None, None
    if np.quantile(closable, tail) > 0:
        shares = 100 * (before - after)[drawn].sum(axis=1) / closable
        share = float(100 * (before - after).sum() / (before - floor).sum())
        if len(before) > 1:
            low, high = np.quantile(shares, (tail, 1 - tail))
            interval = (float(low), float(high))
    return Closed(
        before=float(before.mean()),
        after=float(after.mean()),
        floor=float(floor.mean()),
        closed_pct=share,
        interval=interval,
    )
