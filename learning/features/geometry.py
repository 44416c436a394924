"""Geometry that makes stereo fail: visibility, depth edges along rows, thickness of objects."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numba as nb
import numpy as np
from numpy.typing import NDArray

from starling.patterns import errors
from starling.sim.metrics import EDGE_JUMP_PX

Image = NDArray[np.float32]

FARTHEST_BORDER_PX = 64.0  # Greatest distance to a border [px].
_NEARER_PX = 1.0  # An occluder is nearer by more than this disparity [px].


@dataclass(frozen=True, slots=True, eq=False)
class Visibility:
    """Visibility from one place, all (h, w) in the left view."""

    hidden: NDArray[np.bool_]
    behind_px: Image  # Distance behind the occluding edge, seen from that place; 0 if none.
    border_px: Image  # Distance to the border of the hidden region: > 0 inside, < 0 outside.


def seen_from(disparity_px: Image, fraction: float) -> Visibility:
    """Compute the visibility from a place on the baseline.

    From a place at a fraction f of the baseline to the right, pixel u of the left view appears at
    u - f d. A surface is hidden if a nearer one appears at the same place.

    Args:
        disparity_px: (h, w), no NaN.
        fraction: 1 = the right imager; below 0, the place is left of the left imager.

    Returns:
        The hidden region. `behind_px` is measured along the row from the occluding edge in pixels
        of that view. It continues behind objects so thin that the surface reappears on their other
        side; the order along the row is reversed there, which matchers do not support.

    Raises:
        InputError: if `fraction` is not in [-4, 4].
    """
    errors.in_interval("fraction", fraction, -4.0, 4.0)
    disparity_px = np.ascontiguousarray(disparity_px, np.float32)
    mirrored = fraction < 0  # A place on the left is equivalent to one on the right, mirrored.
    if mirrored:
        disparity_px = np.ascontiguousarray(disparity_px[:, ::-1])
    hidden, behind = _rows(disparity_px, abs(float(fraction)), _NEARER_PX)
    if mirrored:
        hidden, behind = hidden[:, ::-1], behind[:, ::-1]
    return Visibility(hidden, np.ascontiguousarray(behind), signed_distance(hidden))


def signed_distance(inside: NDArray[np.bool_]) -> Image:
    """Distance [px] to the border of a mask, > 0 inside, < 0 outside, clipped at 64 px; (h, w)."""
    mask = np.ascontiguousarray(inside, np.uint8)
    # Half a pixel: the border lies between the last pixel inside and the first outside.
    within = np.asarray(cv2.distanceTransform(mask, cv2.DIST_L2, 5)) - np.float32(0.5)
    without = np.asarray(cv2.distanceTransform(1 - mask, cv2.DIST_L2, 5)) - np.float32(0.5)
    distance = np.where(inside, within, -without)
    return np.clip(distance, -FARTHEST_BORDER_PX, FARTHEST_BORDER_PX).astype(np.float32)


@nb.njit(nogil=True, cache=True)
def _rows(disparity: Image, fraction: float, nearer: float) -> tuple[NDArray[np.bool_], Image]:
    height, width = disparity.shape
    hidden = np.zeros((height, width), np.bool_)
    behind = np.zeros((height, width), np.float32)
    for v in range(height):
        # Nearest surface at each place of the other view, including places left of its image.
        reach = int(np.ceil(max(fraction * disparity[v].max(), 0.0))) + 2
        nearest = np.full(width + reach + 2, -np.inf)
        for u in range(width):
            place = u - fraction * disparity[v, u] + reach
            for i in range(int(np.floor(place)), int(np.ceil(place)) + 1):
                nearest[i] = max(nearest[i], disparity[v, u])
        leftmost = np.inf
        for u in range(width - 1, -1, -1):
            place = u - fraction * disparity[v, u] + reach
            if place > leftmost:
                behind[v, u] = place - leftmost
                near = min(nearest[int(np.floor(place))], nearest[int(np.ceil(place))])
                hidden[v, u] = near > disparity[v, u] + nearer
            leftmost = min(leftmost, place)
    return hidden, behind


Image = NDArray[np.float32]

FARTHEST_EDGE_PX = 128.0  # Edges farther away count as none [px].


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
    return RowEdges(*_left(np.ascontiguousarray(disparity_px), EDGE_JUMP_PX, FARTHEST_EDGE_PX))


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
