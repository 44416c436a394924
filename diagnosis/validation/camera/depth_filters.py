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
_LAST_CODE = 65535
# The spatial filter's defaults (librealsense, doc/post-processing-filters.md): 20 thirty-seconds.
_SPATIAL_DELTA_PX = 0.625
_SPATIAL_ITERATIONS = 2


def process(depth_m: Map, strengths: Strengths) -> Map:
    """Apply every effect on matched depth to one frame.

    The order is that of the matcher's last steps, then librealsense's: range, spatial, hole
    filling, depth unit.

    Args:
        depth_m: Depth z [m].
        strengths: The effects.

    Returns:
        Depth [m]; the very map given where nothing acts.
    """
    fb = strengths.nominal.focal_baseline_px_m
    z = within(_through_disparity(depth_m, strengths, fb), strengths.of("range"))
    alpha = strengths.of("spatial_filter")
    if alpha != 1.0:
        z = fb / smooth_space(fb / z, alpha, _SPATIAL_DELTA_PX, _SPATIAL_ITERATIONS)
    z = fill(z, round(strengths.of("hole_filling")))
    return in_units(z, strengths.of("depth_unit")) if strengths.acting("depth_unit") else z


def _through_disparity(depth_m: Map, strengths: Strengths, fb: float) -> Map:
    disparity_px = fb / depth_m
    refined = disparity_filters.refine(disparity_px, strengths)
    if refined is disparity_px:
        return depth_m
    return fb / np.where(refined > 0, refined, np.nan)


def within(depth_m: Map, near_m: float) -> Map:
    """Keep depth from `near_m` on, which is included; the page's far end is a map's last code."""
    out = depth_m < near_m
    return np.where(out, np.nan, depth_m) if out.any() else depth_m


def smooth_space(disparity_px: Map, alpha: float, delta_px: float, iterations: int) -> Map:
    """Average recursively along columns and rows, starting afresh at jumps and holes.

    out[i] = alpha in[i] + (1 - alpha) out[i-1] where |in[i] - in[i-1]| < delta (Gastal and Oliveira
    2011, sec. 5), down, up, to the right and to the left.
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
        near = np.abs(d[row] - d[row - 1]) < delta_px  # False beside a hole.
        out[row] = np.where(near, alpha * d[row] + (1.0 - alpha) * out[row - 1], d[row])
    return out


def fill(depth_m: Map, mode: int) -> Map:
    """Give missing pixels a neighbour's depth, row by row; what was filled fills the next.

    Args:
        depth_m: Depth [m].
        mode: 0 off; `LEFT` the last depth of the row; `FARTHEST` and `NEAREST` of the neighbours to
            the left, upper left, lower left, above and below, `NEAREST` only under depth.
    """
    if mode == 0:
        return depth_m
    out = depth_m.copy()
    if mode == LEFT:
        at = np.where(np.isfinite(out), np.arange(out.shape[1])[None, :], 0)
        return np.take_along_axis(out, np.maximum.accumulate(at, axis=1), axis=1)
    for row, column in np.argwhere(np.isnan(out)):  # In order of rows, then columns.
        if column == 0 or (mode == NEAREST and not (row > 0 and out[row - 1, column] > 0)):
            continue
        rows = slice(max(row - 1, 0), row + 2)
        beside = np.append(out[rows, column - 1], out[rows, column])
        known = beside[np.isfinite(beside)]
        if len(known):
            out[row, column] = known.max() if mode == FARTHEST else known.min()
    return out


def in_units(depth_m: Map, unit_m: float) -> Map:
    """Round to whole units, none of which may be below 1 or above 65535."""
    code = np.rint(depth_m / unit_m)
    return np.where((code >= 1) & (code <= _LAST_CODE), code * unit_m, np.nan)
