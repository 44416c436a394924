"""Post-processing of depth maps: range, spatial and hole filters, depth unit.

Every map is (h, w), NaN where there is no depth.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from starling.diagnosis.validation.camera import disparity_filters
from starling.diagnosis.validation.camera.catalogue import Strengths

Map = NDArray[np.float64]

LEFT, FARTHEST, NEAREST = 1, 2, 3  # Modes of hole filling; 0 is off.
_LAST_CODE = 65535  # Largest code of a 16 bit depth map.
# Defaults of the spatial filter (librealsense, doc/post-processing-filters.md).
_SPATIAL_DELTA_PX = 0.625  # Largest smoothed step: 20 of 32 subpixel units [px].
_SPATIAL_ITERATIONS = 2


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
    z = within(_through_disparity(depth_m, strengths, fb), strengths.value("range"))
    alpha = strengths.value("spatial_filter")
    if alpha != 1.0:
        z = fb / smooth_space(fb / z, alpha, _SPATIAL_DELTA_PX, _SPATIAL_ITERATIONS)
    z = fill(z, round(strengths.value("hole_filling")))
    return in_units(z, strengths.value("depth_unit")) if strengths.is_active("depth_unit") else z


def _through_disparity(depth_m: Map, strengths: Strengths, fb: float) -> Map:
    disparity_px = fb / depth_m
    refined = disparity_filters.refine(disparity_px, strengths)
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
