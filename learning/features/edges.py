"""Depth edges along the rows: how far, how high, and on which side a pixel stands."""

from __future__ import annotations

from dataclasses import dataclass

import numba as nb
import numpy as np
from numpy.typing import NDArray

from starling.sim.metrics import EDGE_JUMP_PX

Image = NDArray[np.float32]

FARTHEST_PX = 128.0  # An edge farther away counts as none.


@dataclass(frozen=True, slots=True, eq=False)
class RowEdges:
    """The nearest depth edge on one side of each pixel, all (h, w)."""

    distance_px: Image  # To the edge, which lies between two pixels: 0.5 beside it; 128 if none.
    step_px: Image  # Disparity beyond it less before it: > 0 in front of this side, 0 if none.


def edges_left(disparity_px: Image) -> RowEdges:
    """Find the nearest depth edge to the left of each pixel.

    Neighbours that differ by more than 1 px of disparity have an edge between them, as everywhere
    (`starling.sim.metrics`); at a slope so steep, the other imager sees nothing of the surface either.

    Args:
        disparity_px: (h, w), no NaN.
    """
    return RowEdges(*_left(np.ascontiguousarray(disparity_px), EDGE_JUMP_PX, FARTHEST_PX))


def edges_right(disparity_px: Image) -> RowEdges:
    """Find the nearest depth edge to the right of each pixel; as `edges_left`."""
    mirrored = edges_left(disparity_px[:, ::-1])
    return RowEdges(mirrored.distance_px[:, ::-1], mirrored.step_px[:, ::-1])


@nb.njit(nogil=True, cache=True)
def _left(  # pragma: no cover - compiled
    disparity: Image, jump: float, farthest: float
) -> tuple[Image, Image]:
    height, width = disparity.shape
    distance = np.full((height, width), farthest, np.float32)
    step = np.zeros((height, width), np.float32)
    for v in range(height):
        away, high = farthest, np.float32(0)
        for u in range(1, width):
            rise = disparity[v, u - 1] - disparity[v, u]
            if abs(rise) > jump:
                away, high = 0.5, rise
            else:
                away += 1.0
            if away < farthest:
                distance[v, u] = away
                step[v, u] = high
    return distance, step
