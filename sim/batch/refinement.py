"""Kernels that refine disparities (n, h, w): median, and edge-preserving mean.

`starling.sim.stereo.subpixel` is the reference.
"""
# pyright: reportInvalidTypeForm=false

from __future__ import annotations

from functools import cache
from typing import Any

from starling.sim.batch import handoff

wp: Any = handoff.import_warp()  # Annotations of kernels are values, not types.

wp.set_module_options({"enable_backward": False})

_Window3 = wp.types.vector(9, wp.float32)
_Window5 = wp.types.vector(25, wp.float32)
_WINDOWS: dict[int, Any] = {3: _Window3, 5: _Window5}


def comparisons(count: int) -> list[tuple[int, int]]:
    """Return the pairs that a network exchanges in turn to sort `count` values.

    Source: Batcher's odd-even merge sort; Knuth, TAOCP vol. 3, sec. 5.2.2, algorithm M.
    """
    pairs: list[tuple[int, int]] = []
    top = 1 << ((count - 1).bit_length() - 1)
    p = top
    while p > 0:
        q, r, d = top, 0, p
        while True:
            pairs += [(i, i + d) for i in range(count - d) if i & p == r]
            if q == p:
                break
            d, q, r = q - p, q // 2, p
        p //= 2
    return pairs


@cache
def median(side: int) -> Any:
    """Return the kernel of a median over a square window of 3 or 5 px.

    The kernel fills an image (n, h, w) from another. NaN counts as 0 in a window, and stays.

    Args:
        side: side of the window [px].
    """
    window = _WINDOWS[side]
    pairs = comparisons(side * side)
    count, pair_count, middle, reach = side * side, len(pairs), side * side // 2, side // 2

    @wp.kernel(module="unique", enable_backward=False, module_options={"max_unroll": 256})
    def take_median(
        disparity: wp.array3d(dtype=float), out: wp.array3d(dtype=float)
    ):  # pragma: no cover - compiled
        e, y, x = wp.tid()
        h = disparity.shape[1]
        w = disparity.shape[2]
        values = window()
        for k in range(count):
            row = wp.clamp(y + k // side - reach, 0, h - 1)
            value = disparity[e, row, wp.clamp(x + k % side - reach, 0, w - 1)]
            values[k] = wp.where(wp.isnan(value), 0.0, value)
        for k in range(pair_count):
            low = values[wp.static(pairs[k][0])]
            high = values[wp.static(pairs[k][1])]
            values[wp.static(pairs[k][0])] = wp.min(low, high)
            values[wp.static(pairs[k][1])] = wp.max(low, high)
        centre = disparity[e, y, x]
        if wp.isnan(centre) or values[middle] <= 0.0:
            out[e, y, x] = centre
        else:
            out[e, y, x] = values[middle]

    return take_median


@wp.func
def rounded(value: float, quantum: float) -> float:  # pragma: no cover - compiled
    """Round to multiples of a quantum; 0 leaves the value."""
    if quantum > 0.0:
        return wp.rint(value / quantum) * quantum
    return value


@wp.kernel
def average(
    disparity: wp.array3d(dtype=float),
    weight: wp.array3d(dtype=float),
    side: int,
    down: int,
    step: float,
    quantum: float,
    out: wp.array3d(dtype=float),
    gathered: wp.array3d(dtype=float),
):  # pragma: no cover - compiled
    """Average along one axis neighbours within a step of the centre.

    Args:
        disparity: (n, h, w) [px], NaN without disparity.
        weight: (n, h, w), >= 0; () weights all pixels equally.
        side: window [px]; an even one has one pixel more before the centre than after.
        down: 1 averages along columns, 0 along rows.
        step: largest difference to the centre [px].
        quantum: step of the quotient [px]; 0 = no rounding.
        out: (n, h, w) is filled.
        gathered: (n, h, w) filled with the summed weights.
    """
    e, y, x = wp.tid()
    h = disparity.shape[1]
    w = disparity.shape[2]
    centre = disparity[e, y, x]
    total = wp.float32(0.0)
    count = wp.float32(0.0)
    before = side // 2
    for k in range(-before, side - before):
        row = y + k * down
        column = x + k * (1 - down)
        if row >= 0 and row < h and column >= 0 and column < w:
            off = disparity[e, row, column] - centre
            if wp.abs(off) <= step:  # False for NaN.
                counts = wp.float32(1.0)
                if weight.shape[0] > 0:
                    counts = weight[e, row, column]
                total += off * counts
                count += counts
    if count > 0.0:
        centre += rounded(total / count, quantum)
    out[e, y, x] = centre
    gathered[e, y, x] = count
