"""Decimation filter: each block of pixels is reduced to one value."""

from __future__ import annotations

import numba as nb
import numpy as np
from numpy.typing import NDArray

_LARGEST_MEDIAN = 3  # Largest block side for the median [px]; larger blocks use the mean.


def decimate(disparity_px: NDArray[np.float32], side: int) -> NDArray[np.float32]:
    """Reduce every block of `side` x `side` pixels to one value; blocks start at pixel (0, 0).

    Blocks of side 2 and 3 take the median depth of their valid pixels; of an even count, the nearer
    of the two middle ones. Larger blocks take the mean depth, which is a harmonic mean of
    disparities.

    Args:
        disparity_px: (h, w) [px], > 0, NaN = none.
        side: side of a block [px]; 1 returns the input array.

    Returns:
        (h // side, w // side) [px of the input], NaN for blocks without valid pixels. Incomplete
        blocks at the right and at the bottom are dropped.

    Source: librealsense, decimation filter.
    """
    if side == 1:
        return disparity_px
    return _decimate(np.ascontiguousarray(disparity_px, np.float32), side, side <= _LARGEST_MEDIAN)


def enlarge(
    blocks_px: NDArray[np.float32], side: int, shape: tuple[int, int]
) -> NDArray[np.float32]:
    """Set every pixel to its block's value.

    Args:
        blocks_px: (h // side, w // side) from `decimate`.
        side: side of a block [px]; 1 returns the input array.
        shape: (h, w) of the result.

    Returns:
        (h, w), NaN outside complete blocks.
    """
    if side == 1:
        return blocks_px
    out = np.full(shape, np.nan, np.float32)
    rows, columns = blocks_px.shape
    within = out[: rows * side, : columns * side].reshape(rows, side, columns, side)
    within[:] = blocks_px[:, None, :, None]
    return out


@nb.njit(nogil=True, cache=True)
def _decimate(disparity, side, median):  # pragma: no cover - compiled
    rows, columns = disparity.shape[0] // side, disparity.shape[1] // side
    out = np.empty((rows, columns), np.float32)
    values = np.empty(side * side, np.float32)  # Values of one block, ascending.
    for row in range(rows):
        for column in range(columns):
            count, depths = 0, np.float32(0)
            for y in range(row * side, (row + 1) * side):
                for x in range(column * side, (column + 1) * side):
                    value = disparity[y, x]
                    if value != value:  # NaN: no disparity.
                        continue
                    depths += np.float32(1) / value
                    place = count
                    while median and place > 0 and values[place - 1] > value:
                        values[place] = values[place - 1]
                        place -= 1
                    values[place] = value
                    count += 1
            if count == 0:
                out[row, column] = np.nan
            elif median:
                out[row, column] = values[count // 2]
            else:
                out[row, column] = np.float32(count) / depths
    return out
