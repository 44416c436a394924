"""The gap in bins of covariates, with p-values over rooms corrected for all bins at once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from starling.diagnosis.scenes.rooms import interval, resample_rooms, room_means
from starling.diagnosis.scenes.strata import Mask, Strata
from starling.sim.arrays import mean_known

MATERIAL = "material"  # Covariate in addition to those of `starling.diagnosis.scenes.strata`.
_FEWEST = 200  # Least number of pixels of a scene in a bin.
_DRAWS = 2000  # Random signs, and bootstrap samples.
_CANCELS = 0.1  # Net over gross gap up to which gaps count as cancelling each other.


@dataclass(frozen=True, kw_only=True, slots=True)
class BinGap:
    """The gap in one bin of one covariate."""

    covariate: str
    bin: str
    gap: float  # Mean over scenes: share of True pixels in the second map minus the first.
    low: float  # 95 % bootstrap interval over rooms; NaN for too few rooms.
    high: float
    area: float  # Share of the counted pixels in the bin.
    share: float  # Share of the whole gap in the bin; NaN if gaps cancel (see `share_of_gap`).
    p: float  # Probability of as large a standardised gap in any bin if rooms had random signs.


def share_of_gap(part: float, total: float, gross: float) -> float:
    """Return the share of a part in the whole gap; NaN if gaps cancel to a tenth or less.

    Args:
        part: net gap of the part.
        total: net gap of all parts.
        gross: sum of the absolute gaps of the parts.
    """
    return part / total if abs(total) > _CANCELS * gross else float("nan")


def bin_gaps(
    first: Sequence[NDArray[np.bool_]],
    second: Sequence[NDArray[np.bool_]],
    scene_strata: Sequence[Strata],
    rooms: Sequence[str],
    materials: Sequence[Mapping[str, Mask]] = (),
) -> list[BinGap]:
    """Measure where the second maps are True and the first are not, bin by bin.

    Args:
        first: (h, w) mask of each scene, True without depth or with wrong depth.
        second: masks to compare with, in the same order.
        grounds: of the scenes.
        rooms: room of each scene; the signs of room means are drawn at random.
        materials: counted pixels of each scene by material, as one more covariate; may be empty.

    Returns:
        Bins with the smallest p-values first, equal ones by size of the gap.

    Source: the maximum over bins under sign flips controls the family-wise error (Westfall and
    Young, Resampling-Based Multiple Testing, 1993).
    """
    keys = [
        (covariate.name, word)
        for covariate in scene_strata[0].covariates.values()
        for word in covariate.bins
    ]
    keys += [(MATERIAL, name) for name in sorted({name for masks in materials for name in masks})]
    gaps = np.full((len(scene_strata), len(keys)), np.nan)
    area = np.zeros(len(keys))
    net = np.zeros(len(keys))
    total, pixels = 0.0, 0
    for scene, (before, after, strata) in enumerate(zip(first, second, scene_strata, strict=True)):
        change = after.astype(np.int8) - before.astype(np.int8)
        scene_masks = materials[scene] if materials else {}
        total += float(change[strata.counted].sum())
        pixels += int(strata.counted.sum())
        for column, (name, word) in enumerate(keys):
            if name == MATERIAL:
                where = scene_masks.get(word, np.zeros(change.shape, bool))
            else:
                where = strata.covariates[name].mask(word)
            count = np.count_nonzero(where)
            area[column] += count
            net[column] += float(change[where].sum())
            if count >= _FEWEST:
                gaps[scene, column] = change[where].mean()
    by_covariate: dict[str, float] = {}
    for (name, _), part in zip(keys, net, strict=True):
        by_covariate[name] = by_covariate.get(name, 0.0) + abs(float(part))
    gross = max(by_covariate.values())
    p = _max_t(room_means(gaps, rooms))
    low, high = _interval(gaps, rooms)
    rows = [
        BinGap(
            covariate=name,
            bin=word,
            gap=float(np.nanmean(gaps[:, column])),
            low=float(low[column]),
            high=float(high[column]),
            area=float(area[column] / max(pixels, 1)),
            share=share_of_gap(float(net[column]), total, gross),
            p=float(p[column]),
        )
        for column, (name, word) in enumerate(keys)
        if np.isfinite(gaps[:, column]).any()
    ]
    return sorted(rows, key=lambda row: (row.p, -abs(row.gap)))


def _max_t(gaps: NDArray) -> NDArray:
    """Return the p-value of each column's |t| among the largest |t| under random room signs."""
    rng = np.random.default_rng(0)
    signs = rng.choice((-1.0, 1.0), size=(_DRAWS, len(gaps)))
    observed = np.abs(_t(gaps[None]))[0]
    largest = np.nanmax(np.abs(_t(gaps[None] * signs[:, :, None])), axis=1)
    return np.array([(1 + np.sum(largest >= value)) / (1 + _DRAWS) for value in observed])


def _t(gaps: NDArray) -> NDArray:
    count = np.isfinite(gaps).sum(axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.nansum(gaps, axis=1) / count
        variance = np.nansum((gaps - mean[:, None]) ** 2, axis=1) / (count - 1)
        t = mean / np.sqrt(variance / count + 1e-10)
    return np.where(count > 1, t, 0.0)


def _interval(gaps: NDArray, rooms: Sequence[str]) -> tuple[NDArray, NDArray]:
    """Return 95 % intervals of the means over scenes; NaN for too few rooms."""
    times = resample_rooms(rooms, _DRAWS, np.random.default_rng(1))
    known = np.isfinite(gaps)
    with np.errstate(invalid="ignore"):
        resampled = (times @ np.where(known, gaps, 0.0)) / (times @ known)
    resampled[:, ~known.any(axis=0)] = 0.0  # These columns become no bin.
    middle = mean_known(gaps, axis=0)
    return interval(
        resampled, np.nan_to_num(middle), np.isfinite(room_means(gaps, rooms)).sum(axis=0)
    )
