"""What a matcher's last steps do to a disparity map that another program has matched.

Every map is (h, w) in pixels, NaN where there is no depth; no function here fills a hole.
"""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from starling.diagnosis.validation.camera.catalogue import Strengths

Map = NDArray[np.float64]

_ISLAND_STEP_PX = 1.0  # The page's second parameter.


def refine(disparity_px: Map, strengths: Strengths) -> Map:
    """Apply every effect of a matcher that acts on its result; the very map given where none.

    The map is taken to be of depth in whole units of the nominal camera.
    """
    nominal = strengths.nominal
    d = median(disparity_px, round(strengths.of("median")))
    d = lock(d, strengths.of("pixel_locking"))
    d = steps(d, strengths.of("subpixel_steps"))
    half_unit = 0.5 * nominal.depth_unit_m / nominal.focal_baseline_px_m
    count = round(strengths.of("speckle_filter"))
    return without_islands(d, count, _ISLAND_STEP_PX, half_unit_per_px=half_unit)


def median(disparity_px: Map, side: int) -> Map:
    """Median of the valid pixels of a square; of an even count the mean of the middle two."""
    if side <= 1:
        return disparity_px
    values = np.sort(_around(disparity_px, side).reshape(*disparity_px.shape, -1), axis=-1)
    count = np.isfinite(values).sum(-1, keepdims=True)  # NaN is sorted to the end.
    low = np.take_along_axis(values, np.maximum(count - 1, 0) // 2, -1)
    high = np.take_along_axis(values, count // 2, -1)
    middle = (0.5 * (low + high))[..., 0]
    return np.where(np.isfinite(disparity_px), middle, np.nan)


def lock(disparity_px: Map, amplitude_px: float) -> Map:
    """Pull to whole pixels: d - a sin(2 pi d), the page's own law."""
    if amplitude_px == 0.0:
        return disparity_px
    return disparity_px - amplitude_px * np.sin(2.0 * np.pi * disparity_px)


def steps(disparity_px: Map, step_px: float) -> Map:
    """Round to whole steps, halves upwards."""
    if step_px == 0.0:
        return disparity_px
    return np.floor(disparity_px / step_px + 0.5) * step_px


def without_islands(
    disparity_px: Map, count: int, step_px: float, *, half_unit_per_px: float = 0.0
) -> Map:
    """Remove islands of at most `count` pixels, bounded by steps above `step_px` or by holes.

    The page's law is of disparities before depth was rounded to whole units, which moves a
    disparity d by up to d^2 unit / (2 f b). A step that may be due to that bounds nothing.

    Args:
        disparity_px: The map.
        count: Pixels of the largest island that goes; 0 is off.
        step_px: Largest step within an island [px].
        half_unit_per_px: unit / (2 f b) [1 / px]; 0 for a map that was never rounded.
    """
    if count == 0:
        return disparity_px
    off_px = half_unit_per_px * disparity_px**2
    number = np.arange(disparity_px.size).reshape(disparity_px.shape)
    begins, ends = [], []
    for one, other in ((np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1], np.s_[1:])):
        most_px = step_px + off_px[one] + off_px[other]
        joined = np.abs(disparity_px[one] - disparity_px[other]) <= most_px
        begins.append(number[one][joined])
        ends.append(number[other][joined])
    begin, end = np.concatenate(begins), np.concatenate(ends)
    graph = sparse.coo_array((np.ones(len(begin), bool), (begin, end)), shape=(number.size,) * 2)
    island = connected_components(graph, directed=False)[1]
    size = np.bincount(island)[island].reshape(disparity_px.shape)
    return np.where(size > count, disparity_px, np.nan)


def _around(disparity_px: Map, side: int) -> Map:
    """Squares about every pixel (h, w, side, side); beyond the border there is nothing."""
    padded = np.pad(disparity_px, side // 2, constant_values=np.nan)
    return sliding_window_view(padded, (side, side))
