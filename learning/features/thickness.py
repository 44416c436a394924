"""Thickness of objects in front, and width of gaps between objects, by openings and closings."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.sim.metrics import EDGE_JUMP_PX

Image = NDArray[np.float32]

SIDES_PX = (3, 5, 9, 17, 33)  # Sides of the squares that are tested [px].
THICK_PX = 65.0  # Value if the largest square fits [px].


def thickness(disparity_px: Image) -> Image:
    """Side [px] of the smallest tested square that does not fit into the object in front, (h, w).

    An opening by a square removes everything nearer than its surroundings that the square does not
    fit into, such as a cable or a pole. Smaller is thinner; 65 where nothing is removed.

    Args:
        disparity_px: (h, w), no NaN.

    Source: Serra, Image Analysis and Mathematical Morphology, 1982 (openings, granulometry).
    """
    return _smallest(disparity_px, cv2.MORPH_OPEN, 1.0)


def gap_width(disparity_px: Image) -> Image:
    """Side [px] of the smallest tested square that does not fit into a gap between objects."""
    return _smallest(disparity_px, cv2.MORPH_CLOSE, -1.0)


def _smallest(disparity_px: Image, operation: int, sign: float) -> Image:
    smallest = np.full(disparity_px.shape, THICK_PX, np.float32)
    # Surfaces are extrapolated beyond the image, so that a sloping floor has no edge at the border.
    margin = SIDES_PX[-1]
    image = np.pad(disparity_px, margin, mode="reflect", reflect_type="odd")
    inside = (slice(margin, -margin), slice(margin, -margin))
    for side in reversed(SIDES_PX):
        square = np.ones((side, side), np.uint8)
        changed = np.asarray(cv2.morphologyEx(image, operation, square))
        smallest[sign * (image - changed)[inside] > EDGE_JUMP_PX] = side
    return smallest
