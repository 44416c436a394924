"""Convex pieces of the surfaces in a depth image.

A scene falls apart at depth steps and at concave creases: where two convex bodies touch, their
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

_CREASE_PX = 5  # A crease is looked for between pixels this far on both sides [px].
_CREASE_COS = float(np.cos(np.radians(20)))  # Surfaces that bend less are smooth.
_REGROWN_PX = 8.0  # Pieces get back what the width of steps and creases has taken [px].


def convex_pieces(surface: Surface, disparity_px: Image, *, fewest_px: int) -> NDArray[np.int32]:
    """Label the smooth or convex pieces of a surface.

    Args:
        surface: of a depth image with next to no noise (a scanner's).
        disparity_px: (h, w) the same image's disparity, NaN where unknown.
        fewest_px: pieces of fewer pixels are left out.

    Returns:
        (h, w) labels 1, 2, ... in the order of each piece's first pixel; 0 elsewhere.
    """
    cut = ~surface.known
    for axis in (0, 1):
        cut |= _step(disparity_px, axis) | _crease(surface, axis)
    # One pixel narrower, so that no piece reaches another through a gap of the cut.
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
    step = ~cloud.one_surface(rise, 1.0)
    return np.pad(step, pads[0]) | np.pad(step, pads[1])


def _crease(surface: Surface, axis: int) -> Mask:
    """Pixels (h, w) between two sides whose normals lean towards each other."""
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
    apart, turn = point[second] - point[first], normal[second] - normal[first]
    crease[inside] = bent & ((apart * turn).sum(axis=-1) < 0)
    return crease


def _regrown(label: NDArray[np.int32], disparity: Image) -> NDArray[np.int32]:
    """Give unlabelled pixels near a piece to it where they go on with its surface."""
    away, nearest = cast(
        tuple[NDArray[np.float64], NDArray[np.int32]],
        ndimage.distance_transform_edt(label == 0, return_indices=True),
    )
    at = tuple(nearest)
    joins = cloud.one_surface(disparity - disparity[at], away) & (away <= _REGROWN_PX)
    return np.where(joins, label[at], 0).astype(np.int32)
