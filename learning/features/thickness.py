"""How thin a thing in front is, and how narrow a gap between things, by openings and closings."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.sim.metrics import EDGE_JUMP_PX

Image = NDArray[np.float32]

SIDES_PX = (3, 5, 9, 17, 33)  # Sides of the squares that are tried.
THICK_PX = 65.0  # What the largest square fits in.


def thickness(disparity_px: Image) -> Image:
    """Side [px] of the smallest square tried that a thing in front does not hold, (h, w).

    An opening by a square takes away what is nearer than its surroundings and holds no such square:
    a pole as wide as a cable or as tall as one. Smaller is thinner; 65 where none is taken away.

    Args:
        disparity_px: (h, w), no NaN.

    Source: Serra, Image Analysis and Mathematical Morphology, 1982 (openings, granulometry).
    """
    return _smallest(disparity_px, cv2.MORPH_OPEN, 1.0)


def gap_width(disparity_px: Image) -> Image:
    """Side [px] of the smallest square tried that the background between things does not hold."""
    return _smallest(disparity_px, cv2.MORPH_CLOSE, -1.0)


def _smallest(disparity_px: Image, operation: int, sign: float) -> Image:
    smallest = np.full(disparity_px.shape, THICK_PX, np.float32)
    # Surfaces go on beyond the image with their slope: a floor that rises to the border is no edge.
    beyond = SIDES_PX[-1]
    image = np.pad(disparity_px, beyond, mode="reflect", reflect_type="odd")
    inside = (slice(beyond, -beyond), slice(beyond, -beyond))
    for side in reversed(SIDES_PX):
        square = np.ones((side, side), np.uint8)
        changed = np.asarray(cv2.morphologyEx(image, operation, square))
        smallest[sign * (image - changed)[inside] > EDGE_JUMP_PX] = side
    return smallest
