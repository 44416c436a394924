"""Post-processing of depth maps: range, decimation, spatial, temporal and hole filters.

Every map is (h, w), NaN where there is no depth.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from diagnosis.withheld import disparity_filters
from diagnosis.withheld.catalogue import Strengths

Map = NDArray[np.float64]

LEFT, FARTHEST, NEAREST = 1, 2, 3  # Modes of hole filling; 0 is off.
_LAST_CODE = 65535
# Persistence: how many of how many frames before must have had depth. 0 is never, 8 always.
_PERSISTENCE = {1: (8, 8), 2: (2, 3), 3: (2, 4), 4: (2, 8), 5: (1, 2), 6: (1, 5), 7: (1, 8)}


def process(depth_m: Sequence[Map], strengths: Strengths) -> tuple[Map, ...]:
    """Apply every effect on matched depth to the frames of one scene.

    The order is that of the matcher's last steps, then librealsense's: decimation, range, spatial,
    temporal, hole filling, depth unit.

    Args:
        depth_m: Depth z [m] of successive frames.
        strengths: The effects.

    Returns:
        Depth [m] of the frames; the very maps given where nothing acts.
    """
    fb = strengths.nominal.focal_baseline_px_m
    frames = [_through_disparity(one, strengths, fb) for one in depth_m]
    frames = [decimate(one, round(strengths.of("decimation"))) for one in frames]
    far_m = strengths.second("range.far_m")
    frames = [within(one, strengths.of("range"), far_m) for one in frames]
    spatial, iterations = strengths.of("spatial_filter"), "spatial_filter.iterations"
    if spatial != 1.0:
        delta_px = strengths.second("spatial_filter.delta_px")
        times = round(strengths.second(iterations))
        frames = [fb / smooth_space(fb / one, spatial, delta_px, times) for one in frames]
    temporal = strengths.of("temporal_filter")
    if temporal != 1.0:
        delta_px = strengths.second("temporal_filter.delta_px")
        persistence = round(strengths.second("temporal_filter.persistence"))
        over_time = smooth_time([fb / one for one in frames], temporal, delta_px, persistence)
        frames = [fb / one for one in over_time]
    frames = [fill(one, round(strengths.of("hole_filling"))) for one in frames]
    return tuple(in_units(one, strengths.of("depth_unit")) for one in frames)


def _through_disparity(depth_m: Map, strengths: Strengths, fb: float) -> Map:
    disparity_px = fb / depth_m
    refined = disparity_filters.refine(disparity_px, strengths)
    if refined is disparity_px:
        return depth_m
    return fb / np.where(refined > 0, refined, np.nan)


def within(depth_m: Map, near_m: float, far_m: float) -> Map:
    """Keep depth from `near_m` to `far_m`, both included."""
    out = (depth_m < near_m) | (depth_m > far_m)
    return np.where(out, np.nan, depth_m) if out.any() else depth_m


def decimate(depth_m: Map, side: int) -> Map:
    """Give every block of side x side pixels one depth: median up to 3, mean from 4 on.

    Blocks begin at pixel (0, 0); those at the right and lower border are what is left of them. The
    image keeps its size.
    """
    if side <= 1:
        return depth_m
    height, width = depth_m.shape
    pad = ((0, -height % side), (0, -width % side))
    padded = np.pad(depth_m, pad, constant_values=np.nan)
    rows, columns = padded.shape[0] // side, padded.shape[1] // side
    blocks = padded.reshape(rows, side, columns, side).swapaxes(1, 2).reshape(rows, columns, -1)
    count = np.isfinite(blocks).sum(-1)
    if side <= 3:
        at = np.maximum(count - 1, 0)[..., None] // 2  # Of an even count the nearer one.
        one = np.take_along_axis(np.sort(blocks, -1), at, -1)[..., 0]
    else:
        one = np.nansum(blocks, -1) / np.where(count > 0, count, np.nan)
    return np.repeat(np.repeat(one, side, 0), side, 1)[:height, :width]


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


def smooth_time(
    disparity_px: Sequence[Map], alpha: float, delta_px: float, persistence: int
) -> tuple[Map, ...]:
    """Average recursively over frames; old depth stands in for none by the persistence.

    Args:
        disparity_px: Successive frames.
        alpha: Weight of the new frame.
        delta_px: Larger changes are taken as they are.
        persistence: 0 to 8; counted over the frames before this one.
    """
    old = np.full(disparity_px[0].shape, np.nan)
    had: list[NDArray[np.bool_]] = []
    out = []
    for new in disparity_px:
        valid = np.isfinite(new)
        near = np.abs(new - old) < delta_px
        now = np.where(near, alpha * new + (1.0 - alpha) * old, new)
        now = np.where(~valid & _persists(had, persistence, valid.shape), old, now)
        old = np.where(np.isfinite(now), now, old)
        had.append(valid)
        out.append(now)
    return tuple(out)


def _persists(
    had: list[NDArray[np.bool_]], persistence: int, shape: tuple[int, int]
) -> NDArray[np.bool_]:
    if persistence == 8:
        return np.ones(shape, bool)
    if persistence == 0 or not had:
        return np.zeros(shape, bool)
    least, of = _PERSISTENCE[persistence]
    return np.sum(had[-of:], axis=0) >= least


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
    """Round to whole units, none of which may be below 1 or above 65535; 0 is off."""
    if unit_m == 0.0:
        return depth_m
    code = np.rint(depth_m / unit_m)
    return np.where((code >= 1) & (code <= _LAST_CODE), code * unit_m, np.nan)
