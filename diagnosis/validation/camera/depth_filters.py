"""Effects on matched depth: refinement of disparities, filters of depth maps, depth unit.

Every map is (h, w), NaN where there is no depth. Depth is in metres, disparity in pixels.
"""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from starling.diagnosis.validation.camera.catalogue import Strengths

Map = NDArray[np.float64]

LEFT, FARTHEST, NEAREST = 1, 2, 3  # Modes of hole filling; 0 is off.
_LAST_CODE = 65535  # Largest code of a 16 bit depth map.
# Defaults of the spatial filter (librealsense, doc/post-processing-filters.md).
_SPATIAL_DELTA_PX = 0.625  # Largest smoothed step: 20 of 32 subpixel units [px].
_SPATIAL_ITERATIONS = 2
_ISLAND_STEP_PX = 1.0  # Second parameter on the page of `speckle_filter` [px].


def process(depth_m: Map, strengths: Strengths) -> Map:
    """Apply all effects on matched depth to one frame.

    The refinement steps of the matcher come first. The order of librealsense follows: range,
    spatial filter, hole filling, depth unit.

    Args:
        depth_m: Depth z (h, w) [m].
        strengths: Nominal camera and effect strengths.

    Returns:
        Depth (h, w) [m], or `depth_m` itself if no effect is active.
    """
    fb = strengths.nominal.focal_baseline_px_m
    z = within(_through_disparity(depth_m, strengths, fb), strengths["range"])
    alpha = strengths["spatial_filter"]
    if alpha != 1.0:
        z = fb / smooth_space(fb / z, alpha, _SPATIAL_DELTA_PX, _SPATIAL_ITERATIONS)
    z = fill(z, round(strengths["hole_filling"]))
    return in_units(z, strengths["depth_unit"]) if strengths.is_active("depth_unit") else z


def _through_disparity(depth_m: Map, strengths: Strengths, fb: float) -> Map:
    disparity_px = fb / depth_m
    refined = refine(disparity_px, strengths)
    if refined is disparity_px:
        return depth_m
    return fb / np.where(refined > 0, refined, np.nan)


def within(depth_m: Map, near_m: float) -> Map:
    """Remove depth below `near_m`. The far limit of the effect page is the largest code."""
    too_near = depth_m < near_m
    return np.where(too_near, np.nan, depth_m) if too_near.any() else depth_m


def smooth_space(disparity_px: Map, alpha: float, delta_px: float, iterations: int) -> Map:
    """Smooth recursively along columns and rows. The recursion restarts at jumps and holes.

    out[i] = alpha in[i] + (1 - alpha) out[i-1] where |in[i] - in[i-1]| < delta (Gastal and Oliveira
    2011, sec. 5). Passes run down, up, right and left.
    """
    d = disparity_px
    for _ in range(iterations):
        d = _pass(d, alpha, delta_px)
        d = _pass(d[::-1], alpha, delta_px)[::-1]
        d = _pass(d.T, alpha, delta_px).T
        d = _pass(d.T[::-1], alpha, delta_px)[::-1].T
    return d


def _pass(d: Map, alpha: float, delta_px: float) -> Map:
    out = d.copy()
    for row in range(1, len(d)):
        smooth = np.abs(d[row] - d[row - 1]) < delta_px  # False next to a hole.
        out[row] = np.where(smooth, alpha * d[row] + (1.0 - alpha) * out[row - 1], d[row])
    return out


def fill(depth_m: Map, mode: int) -> Map:
    """Fill holes with the depth of a neighbour in raster order. Filled pixels fill the next ones.

    Args:
        depth_m: Depth (h, w) [m].
        mode: Source of the depth. Mode 0 is off. Mode `LEFT` repeats the last depth of the row.
            Modes `FARTHEST` and `NEAREST` choose among the left, upper left, lower left, upper and
            lower neighbours. Mode `NEAREST` fills a pixel only if the pixel above has depth.
    """
    if mode == 0:
        return depth_m
    out = depth_m.copy()
    if mode == LEFT:
        source = np.where(np.isfinite(out), np.arange(out.shape[1])[None, :], 0)
        return np.take_along_axis(out, np.maximum.accumulate(source, axis=1), axis=1)
    for row, column in np.argwhere(np.isnan(out)):  # Raster order.
        if column == 0 or (mode == NEAREST and not (row > 0 and out[row - 1, column] > 0)):
            continue
        rows = slice(max(row - 1, 0), row + 2)
        neighbours = np.append(out[rows, column - 1], out[rows, column])
        known = neighbours[np.isfinite(neighbours)]
        if len(known):
            out[row, column] = known.max() if mode == FARTHEST else known.min()
    return out


def in_units(depth_m: Map, unit_m: float) -> Map:
    """Round to whole units. Codes below 1 or above 65535 become NaN."""
    code = np.rint(depth_m / unit_m)
    return np.where((code >= 1) & (code <= _LAST_CODE), code * unit_m, np.nan)


def refine(disparity_px: Map, strengths: Strengths) -> Map:
    """Apply all refinement effects. Return the map itself if none is active.

    The map must come from depth in whole units of the nominal camera.
    """
    nominal = strengths.nominal
    d = median(disparity_px, round(strengths["median"]))
    d = lock(d, strengths["pixel_locking"])
    d = steps(d, strengths["subpixel_steps"])
    half_unit = 0.5 * nominal.depth_unit_m / nominal.focal_baseline_px_m
    count = round(strengths["speckle_filter"])
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
