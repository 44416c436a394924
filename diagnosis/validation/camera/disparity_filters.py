"""Disparity refinement effects, applied to a matched disparity map.

Every map is (h, w) [px], NaN where there is no depth. No function here fills a hole.
"""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from starling.diagnosis.validation.camera.catalogue import Strengths

Map = NDArray[np.float64]

_ISLAND_STEP_PX = 1.0  # Second parameter on the page of `speckle_filter` [px].


def refine(disparity_px: Map, strengths: Strengths) -> Map:
    """Apply all refinement effects. Return the map itself if none is active.

    The map must come from depth in whole units of the nominal camera.
    """
    nominal = strengths.nominal
    d = median(disparity_px, round(strengths.value("median")))
    d = lock(d, strengths.value("pixel_locking"))
    d = steps(d, strengths.value("subpixel_steps"))
    half_unit = 0.5 * nominal.depth_unit_m / nominal.focal_baseline_px_m
    count = round(strengths.value("speckle_filter"))
    return without_islands(d, count, _ISLAND_STEP_PX, half_unit_per_px=half_unit)


def median(disparity_px: Map, side: int) -> Map:
    """Take the median of the valid pixels in a square, or the mean of the middle two."""
    if side <= 1:
        return disparity_px
    values = np.sort(_windows(disparity_px, side).reshape(*disparity_px.shape, -1), axis=-1)
    count = np.isfinite(values).sum(-1, keepdims=True)  # NaN sorts to the end.
    low = np.take_along_axis(values, np.maximum(count - 1, 0) // 2, -1)
    high = np.take_along_axis(values, count // 2, -1)
    middle = (0.5 * (low + high))[..., 0]
    return np.where(np.isfinite(disparity_px), middle, np.nan)


def lock(disparity_px: Map, amplitude_px: float) -> Map:
    """Pull disparities towards integers: d - a sin(2 pi d), the law of the effect page."""
    if amplitude_px == 0.0:
        return disparity_px
    return disparity_px - amplitude_px * np.sin(2.0 * np.pi * disparity_px)


def steps(disparity_px: Map, step_px: float) -> Map:
    """Round to multiples of a step, halves upwards."""
    if step_px == 0.0:
        return disparity_px
    return np.floor(disparity_px / step_px + 0.5) * step_px


def without_islands(
    disparity_px: Map, count: int, step_px: float, *, half_unit_per_px: float = 0.0
) -> Map:
    """Remove islands of at most `count` pixels, bounded by steps above `step_px` or by holes.

    The effect page defines the law before depth is rounded to whole units. Rounding moves a
    disparity d by up to d^2 unit / (2 f b), so this tolerance is added to `step_px`.

    Args:
        disparity_px: Disparity map (h, w) [px].
        count: Size of the largest island that is removed [px]; 0 is off.
        step_px: Largest step within an island [px].
        half_unit_per_px: unit / (2 f b) [1 / px]; 0 for a map that was never rounded.
    """
    if count == 0:
        return disparity_px
    rounding_px = half_unit_per_px * disparity_px**2
    number = np.arange(disparity_px.size).reshape(disparity_px.shape)
    begins, ends = [], []
    for first, second in ((np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1], np.s_[1:])):
        most_px = step_px + rounding_px[first] + rounding_px[second]
        joined = np.abs(disparity_px[first] - disparity_px[second]) <= most_px
        begins.append(number[first][joined])
        ends.append(number[second][joined])
    begin, end = np.concatenate(begins), np.concatenate(ends)
    graph = sparse.coo_array((np.ones(len(begin), bool), (begin, end)), shape=(number.size,) * 2)
    island = connected_components(graph, directed=False)[1]
    size = np.bincount(island)[island].reshape(disparity_px.shape)
    return np.where(size > count, disparity_px, np.nan)


def _windows(disparity_px: Map, side: int) -> Map:
    """Square window of every pixel (h, w, side, side), NaN beyond the border."""
    padded = np.pad(disparity_px, side // 2, constant_values=np.nan)
    return sliding_window_view(padded, (side, side))
