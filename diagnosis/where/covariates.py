"""The gap by covariates, with chances over rooms that hold for all rows at once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from starling.diagnosis.scenes.rooms import draws, interval, means
from starling.diagnosis.scenes.strata import Ground, Mask
from starling.sim.statistics import mean_known

MATERIAL = "material"  # Beside the covariates of `starling.diagnosis.scenes.strata`.
_FEWEST = 200  # Pixels of a scene in a bin.
_DRAWS = 2000
_CANCELS = 0.1  # Of all that changed, up to which a net gap is what others leave of each other.


@dataclass(frozen=True, kw_only=True, slots=True)
class Row:
    """One bin of one covariate."""

    covariate: str
    bin: str
    gap: float  # Mean over scenes: second map's share of True pixels less the first's.
    low: float  # 95 % bootstrap interval over rooms; NaN of too few.
    high: float
    area: float  # Share of the counted pixels that lie in it.
    share: float  # Share of the whole gap that lies in it; NaN where gaps cancel (see `share`).
    p: float  # Chance of as large a standardised gap in any row, were signs of rooms arbitrary.


def share(part: float, total: float, gross: float) -> float:
    """Share of a whole gap that is a part's; NaN where gaps cancel but for a tenth of them.

    Args:
        part: net gap of the part.
        total: net gap of all.
        gross: sum of the parts' gaps, whichever way each goes.
    """
    return part / total if abs(total) > _CANCELS * gross else float("nan")


def table(
    first: Sequence[NDArray[np.bool_]],
    second: Sequence[NDArray[np.bool_]],
    grounds: Sequence[Ground],
    rooms: Sequence[str],
    materials: Sequence[Mapping[str, Mask]] = (),
) -> list[Row]:
    """Where the second maps are True and the first are not, by bins.

    Args:
        first: (h, w) of every scene, True without depth, or where depth is off.
        second: likewise.
        grounds: of the scenes.
        rooms: likewise; their means are what signs are drawn of.
        materials: of every scene its counted pixels by material, one more covariate; none if empty.

    Returns:
        Rows by size of the gap, those of the smallest chance first.

    Source: the maximum over rows under sign flips controls all of them at once (Westfall and Young,
    Resampling-Based Multiple Testing, 1993).
    """
    keys = [(one.name, word) for one in grounds[0].covariates.values() for word in one.bins]
    keys += [(MATERIAL, name) for name in sorted({name for one in materials for name in one})]
    gaps = np.full((len(grounds), len(keys)), np.nan)
    area = np.zeros(len(keys))
    net = np.zeros(len(keys))
    total, pixels = 0.0, 0
    for scene, (before, after, ground) in enumerate(zip(first, second, grounds, strict=True)):
        change = after.astype(np.int8) - before.astype(np.int8)
        total += float(change[ground.counted].sum())
        pixels += int(ground.counted.sum())
        for column, (name, word) in enumerate(keys):
            if name == MATERIAL:
                where = materials[scene].get(word, np.zeros(change.shape, bool))
            else:
                where = ground.covariates[name].where(word)
            count = np.count_nonzero(where)
            area[column] += count
            net[column] += float(change[where].sum())
            if count >= _FEWEST:
                gaps[scene, column] = change[where].mean()
    by_covariate: dict[str, float] = {}
    for (name, _), part in zip(keys, net, strict=True):
        by_covariate[name] = by_covariate.get(name, 0.0) + abs(float(part))
    gross = max(by_covariate.values())
    p = _max_t(means(gaps, rooms))
    low, high = _interval(gaps, rooms)
    rows = [
        Row(
            covariate=name,
            bin=word,
            gap=float(np.nanmean(gaps[:, column])),
            low=float(low[column]),
            high=float(high[column]),
            area=float(area[column] / max(pixels, 1)),
            share=share(float(net[column]), total, gross),
            p=float(p[column]),
        )
        for column, (name, word) in enumerate(keys)
        if np.isfinite(gaps[:, column]).any()
    ]
    return sorted(rows, key=lambda row: (row.p, -abs(row.gap)))


def _max_t(gaps: NDArray) -> NDArray:
    """Chance of each column's |t| among the largest |t| under random signs of the rooms."""
    rng = np.random.default_rng(0)
    signs = rng.choice((-1.0, 1.0), size=(_DRAWS, len(gaps)))
    observed = np.abs(_t(gaps[None]))[0]
    largest = np.nanmax(np.abs(_t(gaps[None] * signs[:, :, None])), axis=1)
    return np.array([(1 + np.sum(largest >= one)) / (1 + _DRAWS) for one in observed])


def _t(gaps: NDArray) -> NDArray:
    count = np.isfinite(gaps).sum(axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.nansum(gaps, axis=1) / count
        variance = np.nansum((gaps - mean[:, None]) ** 2, axis=1) / (count - 1)
        found = mean / np.sqrt(variance / count + 1e-10)
    return np.where(count > 1, found, 0.0)


def _interval(gaps: NDArray, rooms: Sequence[str]) -> tuple[NDArray, NDArray]:
    """95 % intervals of the means over scenes (see `rooms.interval`); NaN of too few rooms."""
    times = draws(rooms, _DRAWS, np.random.default_rng(1))
    known = np.isfinite(gaps)
    with np.errstate(invalid="ignore"):
        found = (times @ np.where(known, gaps, 0.0)) / (times @ known)
    found[:, ~known.any(axis=0)] = 0.0  # No row is made of these.
    middle = mean_known(gaps, axis=0)
    return interval(found, np.nan_to_num(middle), np.isfinite(means(gaps, rooms)).sum(axis=0))
