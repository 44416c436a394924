"""Decimation: the pixels of a block become one."""

from __future__ import annotations

import numba as nb
import numpy as np
from numpy.typing import NDArray

_LARGEST_MEDIAN = 3  # Longest side of a block whose median is taken; wider blocks take the mean.


def decimate(disparity_px: NDArray[np.float32], side: int) -> NDArray[np.float32]:
    """Make one value of every block of `side` x `side` pixels, the first at pixel (0, 0).

    Blocks of 2 and 3 pixels a side take the median depth (of an even count the nearer of the two
    in the middle), wider ones the mean depth, both of those pixels that have one. Depth is
    inverse to disparity, so the mean is a harmonic one here.

    Args:
        disparity_px: (h, w) [px], > 0, NaN = none.
        side: of a block [px]; 1 gives the input itself.

    Returns:
        (h // side, w // side) [px of the input], NaN where a whole block had none. What is left
        over at the right and at the bottom is dropped.

    Source: librealsense, decimation filter.
    """
    if side == 1:
        return disparity_px
    return _decimate(np.ascontiguousarray(disparity_px, np.float32), side, side <= _LARGEST_MEDIAN)


def enlarge(
    blocks_px: NDArray[np.float32], side: int, shape: tuple[int, int]
) -> NDArray[np.float32]:
    """Give every pixel its block's value.

    Args:
        blocks_px: (h // side, w // side) from `decimate`.
        side: of a block [px]; 1 gives the input itself.
        shape: (h, w) to fill.

    Returns:
        (h, w), NaN in the rows and columns that make no whole block.
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
    kept = np.empty(side * side, np.float32)  # Of one block, in ascending order.
    for row in range(rows):
        for column in range(columns):
            count, depths = 0, np.float32(0)
            for y in range(row * side, (row + 1) * side):
                for x in range(column * side, (column + 1) * side):
                    value = disparity[y, x]
                    if value != value:  # None.
                        continue
                    depths += np.float32(1) / value
                    place = count
                    while median and place > 0 and kept[place - 1] > value:
                        kept[place] = kept[place - 1]
                        place -= 1
                    kept[place] = value
                    count += 1
            if count == 0:
                out[row, column] = np.nan
            elif median:
                out[row, column] = kept[count // 2]
            else:
                out[row, column] = np.float32(count) / depths
    return out
