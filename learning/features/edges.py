"""Depth edges along rows: distance, height and side of each pixel."""

from __future__ import annotations

from dataclasses import dataclass

import numba as nb
import numpy as np
from numpy.typing import NDArray

from starling.sim.metrics import EDGE_JUMP_PX

Image = NDArray[np.float32]

FARTHEST_PX = 128.0  # Edges farther away count as none [px].


@dataclass(frozen=True, slots=True, eq=False)
class RowEdges:
    """Nearest depth edge on one side of each pixel, all (h, w)."""

    distance_px: Image  # Distance to the edge between two pixels: at least 0.5; 128 if none.
    # Disparity beyond the edge less that before it: > 0 behind an object, 0 if none.
    step_px: Image


def edges_left(disparity_px: Image) -> RowEdges:
    """Find the nearest depth edge to the left of each pixel.

    Neighbours that differ by more than 1 px of disparity have an edge between them, as everywhere
    (`starling.sim.metrics`). The other imager does not see a surface with such a slope either.

    Args:
        disparity_px: (h, w), no NaN.
    """
    return RowEdges(*_left(np.ascontiguousarray(disparity_px), EDGE_JUMP_PX, FARTHEST_PX))


def edges_right(disparity_px: Image) -> RowEdges:
    """Find the nearest depth edge to the right of each pixel; see `edges_left`."""
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
