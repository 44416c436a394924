"""Decimation filter: each block of pixels is reduced to one value."""

from __future__ import annotations

import numba as nb
import numpy as np
from numpy.typing import NDArray

_LARGEST_MEDIAN = 3  # Largest block side for the median [px]; larger blocks use the mean.
_MULTIPLE = 4  # The sides of the result are padded to multiples of it [px].


def decimate(code: NDArray[np.uint16], side: int) -> NDArray[np.uint16]:
    """Reduce every block of `side` x `side` pixels to one value; blocks start at pixel (0, 0).

    Blocks of side 2 and 3 take the median depth of their valid pixels; of an even count, the nearer
    of the two middle ones. Larger blocks take the mean depth, rounded down.

    Args:
        code: (h, w) depth codes, 0 = none.
        side: side of a block [px]; 1 returns the input array.

    Returns:
        (h // side, w // side), 0 for blocks without valid pixels. Incomplete blocks at the right
        and at the bottom are dropped. Zeros pad both sides to multiples of 4, so that later filters
        have the library's image borders.

    Source: librealsense, decimation filter.
    """
    if side == 1:
        return code
    rows, columns = code.shape[0] // side, code.shape[1] // side
    padded = (-(-rows // _MULTIPLE) * _MULTIPLE, -(-columns // _MULTIPLE) * _MULTIPLE)
    out = np.zeros(padded, np.uint16)
    within = out[:rows, :columns]
    _decimate(np.ascontiguousarray(code, np.uint16), side, side <= _LARGEST_MEDIAN, within)
    return out


def enlarge(blocks: NDArray[np.uint16], side: int, shape: tuple[int, int]) -> NDArray[np.uint16]:
    """Set every pixel to its block's value.

    Args:
        blocks: codes from `decimate`.
        side: side of a block [px]; 1 returns the input array.
        shape: (h, w) of the result.

    Returns:
        (h, w), 0 outside complete blocks.
    """
    if side == 1:
        return blocks
    out = np.zeros(shape, np.uint16)
    rows, columns = shape[0] // side, shape[1] // side
    within = out[: rows * side, : columns * side].reshape(rows, side, columns, side)
    within[:] = blocks[:rows, None, :columns, None]
    return out


@nb.njit(nogil=True, cache=True)
def _decimate(code, side, median, out):  # pragma: no cover - compiled
    values = np.empty(side * side, np.uint16)  # Values of one block, ascending.
    for row in range(out.shape[0]):
        for column in range(out.shape[1]):
            count, total = 0, 0
            for y in range(row * side, (row + 1) * side):
                for x in range(column * side, (column + 1) * side):
                    value = code[y, x]
                    if value == 0:
                        continue
                    total += value
                    place = count
                    while median and place > 0 and values[place - 1] > value:
                        values[place] = values[place - 1]
                        place -= 1
                    values[place] = value
                    count += 1
            if count:
                out[row, column] = values[(count - 1) // 2] if median else total // count
