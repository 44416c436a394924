"""Convex pieces of the surfaces in a depth image.

A scene is divided at depth steps and at concave creases. Where two convex bodies touch, their
surface is concave (S. C. Stein et al., Object Partitioning Using Local Convexity, CVPR 2014).
"""

from __future__ import annotations

from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from starling.learning.data.example import Image, Mask
from starling.learning.icp import cloud
from starling.learning.icp.cloud import Surface

_CREASE_PX = 5  # Distance of the pixels on both sides of a crease [px].
_CREASE_COS = float(np.cos(np.radians(20)))  # Surfaces that bend less are smooth.
_REGROWN_PX = 8.0  # Distance by which pieces grow back into steps and creases [px].


def convex_pieces(surface: Surface, disparity_px: Image, *, fewest_px: int) -> NDArray[np.int32]:
    """Label the smooth or convex pieces of a surface.

    Args:
        surface: surface of a depth image with little noise (a scanner's).
        disparity_px: (h, w) disparity of the same image, NaN where unknown.
        fewest_px: least area of a piece [px].

    Returns:
        (h, w) labels 1, 2, ... in the order of each piece's first pixel; 0 elsewhere.
    """
    cut = ~surface.known
    for axis in (0, 1):
        cut |= _step(disparity_px, axis) | _crease(surface, axis)
    # Erode by one pixel, so that pieces do not connect through gaps in the cut.
    free = cv2.erode((~cut).astype(np.uint8), np.ones((3, 3), np.uint8))
    _, label, box, _ = cv2.connectedComponentsWithStats(free, connectivity=4)
    large = box[:, cv2.CC_STAT_AREA] >= fewest_px
    large[0] = False
    number = np.where(large, np.cumsum(large), 0).astype(np.int32)
    return _regrown(number[label.astype(np.intp)], disparity_px)


def _step(disparity: Image, axis: int) -> Mask:
    rise = np.diff(disparity, axis=axis)
    before, after = ((1, 0), (0, 1))
    pads = [[(0, 0), (0, 0)], [(0, 0), (0, 0)]]
    pads[0][axis], pads[1][axis] = before, after
    step = ~cloud.same_surface(rise, 1.0)
    return np.pad(step, pads[0]) | np.pad(step, pads[1])


def _crease(surface: Surface, axis: int) -> Mask:
    """Return pixels (h, w) between two sides whose normals lean towards each other."""
    point, normal = surface.point_m, surface.normal
    size = point.shape[axis] - 2 * _CREASE_PX
    crease = np.zeros(point.shape[:2], bool)
    if size <= 0:
        return crease
    first, second = (
        tuple(slice(start, start + size) if a == axis else slice(None) for a in (0, 1))
        for start in (0, 2 * _CREASE_PX)
    )
    inside = tuple(
        slice(_CREASE_PX, _CREASE_PX + size) if a == axis else slice(None) for a in (0, 1)
    )
    bent = (normal[first] * normal[second]).sum(axis=-1) < _CREASE_COS
    offset, turn = point[second] - point[first], normal[second] - normal[first]
    crease[inside] = bent & ((offset * turn).sum(axis=-1) < 0)
    return crease


def _regrown(label: NDArray[np.int32], disparity: Image) -> NDArray[np.int32]:
    """Assign unlabelled pixels near a piece to it if they continue its surface."""
    away, nearest = cast(
        tuple[NDArray[np.float64], NDArray[np.int32]],
        ndimage.distance_transform_edt(label == 0, return_indices=True),
    )
    source = tuple(nearest)
    joins = cloud.same_surface(disparity - disparity[source], away) & (away <= _REGROWN_PX)
    return np.where(joins, label[source], 0).astype(np.int32)
