"""Hole filling filter: missing depth is copied from a neighbour."""

from __future__ import annotations

import numba as nb
import numpy as np
from numpy.typing import NDArray

from starling.sim.sensor.post import HoleFilling


def fill(disparity_px: NDArray[np.float32], mode: HoleFilling) -> NDArray[np.float32]:
    """Fill holes row by row; filled pixels can fill the next ones.

    "left" repeats the last depth of the row. "farthest" takes the farthest of five neighbours:
    left, upper left, lower left, up, down. "nearest" takes the nearest of them, but only if the
    upper neighbour has depth, because the filter starts with it. Both modes leave the first and
    the last row and the first column unchanged.

    Args:
        disparity_px: (h, w) [px], NaN = none.
        mode: filter mode; "off" returns the input array. A map without holes is also returned.

    Source: librealsense, hole filling filter, modes 0, 1 (default) and 2.
    """
    if mode == "off" or not np.isnan(disparity_px).any():
        return disparity_px
    out = np.array(disparity_px, np.float32, order="C")
    if mode == "left":
        _from_left(out)
    else:
        _from_around(out, mode == "farthest")
    return out


@nb.njit(nogil=True, cache=True)
def _from_left(image):  # pragma: no cover - compiled
    for row in image:
        for x in range(1, row.size):
            if row[x] != row[x]:
                row[x] = row[x - 1]


@nb.njit(nogil=True, cache=True)
def _from_around(image, farthest):  # pragma: no cover - compiled
    h, w = image.shape
    for y in range(1, h - 1):
        above, current, below = image[y - 1], image[y], image[y + 1]
        for x in range(1, w):
            if current[x] == current[x] or (not farthest and above[x] != above[x]):
                continue
            best = above[x]
            for value in (above[x - 1], current[x - 1], below[x - 1], below[x]):
                # Comparisons with NaN are False: any value replaces a missing best, and a missing
                # value replaces nothing.
                if best != best or (value < best if farthest else value > best):
                    best = value
            current[x] = best
