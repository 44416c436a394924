"""Hole filling filter: missing depth is copied from a neighbour."""

from __future__ import annotations

import numba as nb
import numpy as np
from numpy.typing import NDArray

from starling.sim.sensor.post import HoleFilling


def fill(code: NDArray[np.uint16], mode: HoleFilling) -> NDArray[np.uint16]:
    """Fill holes row by row; filled pixels can fill the next ones.

    "left" repeats the last depth of the row. "farthest" takes the farthest of five neighbours:
    left, upper left, lower left, up, down. "nearest" takes the nearest of them, but only if the
    upper neighbour has depth, because the filter starts with it. Both modes leave the first and
    the last row and the first column unchanged.

    Args:
        code: (h, w) depth codes, 0 = none.
        mode: filter mode; "off" returns the input array. A map without holes is also returned.

    Source: librealsense, hole filling filter, modes 0, 1 (default) and 2.
    """
    if mode == "off" or code.all():
        return code
    out = np.array(code, np.uint16, order="C")
    if mode == "left":
        _from_left(out)
    else:
        _from_around(out, mode == "farthest")
    return out


@nb.njit(nogil=True, cache=True)
def _from_left(image):  # pragma: no cover - compiled
    for row in image:
        for x in range(1, row.size):
            if row[x] == 0:
                row[x] = row[x - 1]


@nb.njit(nogil=True, cache=True)
def _from_around(image, farthest):  # pragma: no cover - compiled
    h, w = image.shape
    for y in range(1, h - 1):
        above, current, below = image[y - 1], image[y], image[y + 1]
        for x in range(1, w):
            if current[x] != 0:
                continue
            best = above[x]
            for value in (above[x - 1], current[x - 1], below[x - 1], below[x]):
                # Nothing is nearer than a missing best, which therefore stays missing.
                if value > best if farthest else 0 < value < best:
                    best = value
            current[x] = best
