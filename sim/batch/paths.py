"""Kernels of semi-global matching: scanline paths, and the winners of both views.

A path's costs of all disparities are a tile in the memory of a block of threads.
"""
# pyright: reportInvalidTypeForm=false

from __future__ import annotations

from functools import cache
from typing import Any

from starling.sim.batch import handoff
from starling.sim.stereo.paths import WALL

wp: Any = handoff.import_warp()  # Annotations of kernels are values, not types.

wp.set_module_options({"enable_backward": False})

DIRECTIONS = ((1, 0), (-1, 0), (1, 1), (0, 1), (-1, 1))  # Steps (dx, dy) of the five paths.
_NONE = wp.constant(65535)  # Summed cost before any is known.


@wp.func
def _advance(
    before: wp.int32,
    same: wp.int32,
    after: wp.int32,
    cost: wp.uint16,
    floor: wp.int32,
    p1: wp.int32,
    p2: wp.int32,
) -> wp.int32:  # pragma: no cover - compiled
    """Advance a path by a pixel, for one disparity."""
    return wp.min(wp.min(wp.min(before, after) + p1, same), floor + p2) - floor + int(cost)


@wp.func
def _add(value: wp.int32, total: wp.uint16) -> wp.uint16:  # pragma: no cover - compiled
    return wp.uint16(value + int(total))


@cache
def sweep(search: int) -> Any:
    """Return the kernel that adds the costs of one direction's paths to a volume.

    Launch it tiled, with (n, h) blocks for a direction along rows and (n, w) for the others.

    The kernel takes the volumes of costs and totals, h, w, one of `DIRECTIONS`, and two penalties
    in the unit of the cost.

    Args:
        search: number of disparities.
    """
    span = search + 2
    wall = int(WALL)

    @wp.kernel(module="unique", enable_backward=False)
    def sweep_paths(
        cost: wp.array(dtype=wp.uint16),
        total: wp.array(dtype=wp.uint16),
        h: int,
        w: int,
        dx: int,
        dy: int,
        p1: int,
        p2: int,
    ):  # pragma: no cover - compiled
        e, path = wp.tid()
        steps = h
        if dy == 0:
            steps = w
        state = wp.tile_full(shape=span, value=wall, dtype=wp.int32, storage="shared")
        before = wp.tile_view(state, offset=(0,), shape=(search,))
        same = wp.tile_view(state, offset=(1,), shape=(search,))
        after = wp.tile_view(state, offset=(2,), shape=(search,))
        floor = wp.int32(0)
        for i in range(steps):
            y = i
            x = (path + dx * i) % w  # A diagonal that leaves the image enters at the other side.
            if x < 0:
                x += w
            enters = i == 0
            if dy == 0:
                y = path
                x = i
                if dx < 0:
                    x = w - 1 - i
            elif dx > 0:
                enters = enters or x == 0
            elif dx < 0:
                enters = enters or x == w - 1
            if enters:
                wp.tile_assign(state, wp.tile_zeros(shape=search, dtype=wp.int32), offset=(1,))
                floor = 0
            start = ((e * h + y) * w + x) * search
            pixel = wp.tile_load(cost, shape=search, offset=start)
            value = wp.tile_map(_advance, before, same, after, pixel, floor, p1, p2)
            # The least is taken before the assignment: it waits until all threads have read.
            floor = wp.tile_extract(wp.tile_min(value), 0)
            wp.tile_assign(state, value, offset=(1,))
            summed = wp.tile_map(_add, value, wp.tile_load(total, shape=search, offset=start))
            wp.tile_store(total, summed, offset=start)

    return sweep_paths


@wp.struct
class Peaks:
    """Thresholds of an indistinct winner, its place in the search, and its sub-pixel fit."""

    uniqueness: float  # Least excess of the second best [percent].
    second: int  # The same [cost, summed over the paths].
    neighbour: int  # Least excess of the costlier neighbour [cost, summed over the paths].
    near_end: int  # Whether the largest disparity is accepted.
    equal_slopes: int  # Whether the sub-pixel fit is a V, not a parabola.
    of_sums: int  # Whether it is fitted to the sums of the paths, not to the cost.


@wp.func
def _vertex(
    below: int, middle: int, above: int, equal_slopes: int
) -> wp.vec2:  # pragma: no cover - compiled
    """Fit three costs: vertex in [-1, 1] px from the middle, and curvature.

    The fit is a parabola, or a V whose slopes are equal.
    """
    curvature = wp.max(below + above - 2 * middle, 0)
    vertex = wp.float32(0.0)
    scale = curvature
    if equal_slopes != 0:
        scale = wp.max(below, above) - middle
    if curvature > 0:
        vertex = wp.clamp(float(below - above) / float(2 * scale), -1.0, 1.0)
    return wp.vec2(vertex, float(curvature))


@wp.kernel
def choose_left(
    cost: wp.array(dtype=wp.uint16),
    total: wp.array(dtype=wp.uint16),
    search: int,
    least: int,
    peaks: Peaks,
    best_at: wp.array3d(dtype=wp.int16),
    disparity: wp.array3d(dtype=float),
    bend: wp.array3d(dtype=float),
    ambiguous: wp.array3d(dtype=wp.uint8),
):  # pragma: no cover - compiled
    """Choose the disparity of every pixel of the left view.

    Args:
        cost: flat volume of support costs, for the sub-pixel fit.
        total: flat volume, summed over the paths.
        search: number of disparities.
        least: smallest disparity [px].
        peaks: thresholds and the sub-pixel fit.
        best_at: (n, h, w) filled with whole disparities [px].
        disparity: (n, h, w) filled with disparities [px].
        bend: (n, h, w) filled with the curvature of the cost.
        ambiguous: (n, h, w) set to 1 where the winner is indistinct or at a refused end.
    """
    e, y, x = wp.tid()
    h = best_at.shape[1]
    w = best_at.shape[2]
    start = ((e * h + y) * w + x) * search
    lowest = int(_NONE)
    best = wp.int32(0)
    for d in range(search):
        value = int(total[start + d])
        if value < lowest:
            lowest = value
            best = d
    second = int(_NONE)
    for d in range(search):
        if wp.abs(d - best) > 1:
            second = wp.min(second, int(total[start + d]))
    neighbour = int(total[start + wp.max(best - 1, 0)])
    neighbour = wp.max(neighbour, int(total[start + wp.min(best + 1, search - 1)]))
    inside = best > 0 and best < search - 1
    fit = wp.vec2(0.0, 0.0)
    if inside:
        at_best = start + best
        slopes = peaks.equal_slopes
        if peaks.of_sums != 0:
            above = int(total[at_best + 1])
            fit = _vertex(int(total[at_best - 1]), int(total[at_best]), above, slopes)
        else:
            above = int(cost[at_best + 1])
            fit = _vertex(int(cost[at_best - 1]), int(cost[at_best]), above, slopes)
    margin = 100.0 * (float(second) / float(wp.max(lowest, 1)) - 1.0)
    indistinct = margin < peaks.uniqueness
    indistinct = indistinct or second - lowest < peaks.second
    indistinct = indistinct or neighbour - lowest < peaks.neighbour
    best_at[e, y, x] = wp.int16(best + least)
    disparity[e, y, x] = float(best + least) + fit[0]
    bend[e, y, x] = fit[1]
    ambiguous[e, y, x] = wp.uint8(0)
    accepted = inside or (peaks.near_end != 0 and best == search - 1)
    if indistinct or not accepted:
        ambiguous[e, y, x] = wp.uint8(1)


@wp.kernel
def choose_right(
    cost: wp.array(dtype=wp.uint16),
    total: wp.array(dtype=wp.uint16),
    search: int,
    least: int,
    equal_slopes: int,
    best_at: wp.array3d(dtype=wp.int16),
    disparity: wp.array3d(dtype=float),
):  # pragma: no cover - compiled
    """Choose the disparity of every pixel of the right view, along the volume's diagonal.

    Args:
        cost, total, search, least: as in `choose_left`.
        equal_slopes: whether a V is fitted to the cost, not a parabola.
        best_at: (n, h, w) filled with whole disparities [px], -1 without a match.
        disparity: (n, h, w) filled with disparities [px], NaN without a match.
    """
    e, y, x = wp.tid()
    h = best_at.shape[1]
    w = best_at.shape[2]
    row = (e * h + y) * w
    lowest = int(_NONE)
    best = wp.int32(-1)
    for d in range(search):
        column = x + least + d
        if column < w:
            value = int(total[(row + column) * search + d])
            if value < lowest:
                lowest = value
                best = d
    if best < 0:
        best_at[e, y, x] = wp.int16(-1)
        disparity[e, y, x] = wp.NAN
        return
    column = x + least + best
    fit = wp.vec2(0.0, 0.0)
    if best > 0 and best < search - 1 and column < w - 1:
        at_best = (row + column) * search + best
        below = int(cost[at_best - search - 1])
        above = int(cost[at_best + search + 1])
        fit = _vertex(below, int(cost[at_best]), above, equal_slopes)
    best_at[e, y, x] = wp.int16(best + least)
    disparity[e, y, x] = float(best + least) + fit[0]
