"""A depth image as triangles: cut at depth edges, with the surface behind an edge going on."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.sim.scene.scene import Mesh

Array = NDArray[np.float32]

_JUMP_PX = 1.0  # Neighbours whose disparities differ by more lie on different surfaces.
_NOWHERE = np.float32(-1e6)
_FROM_BEHIND_PX = 4  # How far the farther side of a hole prevails over the nearer.
_FILL_PX = 24  # Holes of the reference up to twice this width are closed from behind.
# Vertices lie off the pixel centres, off-diagonal: a ray through a shared vertex or edge of two
# triangles can miss both.
_OFFSET_PX = (0.13, 0.07)
_BEHIND_PX = 64  # How far a surface goes on behind what stands before it.


def closed(disparity_px: Array) -> Array:
    """Close thin holes with the farthest surface beside them: what is unknown lies behind.

    Args:
        disparity_px: (h, w), NaN where unknown.

    Returns:
        The same, still NaN farther than the limit from anything known.
    """
    unknown = ~np.isfinite(disparity_px)
    # Negative disparity grows with depth; OpenCV's filters take no infinity.
    farther = np.where(unknown, _NOWHERE, -disparity_px).astype(np.float32)
    kernel = np.ones((3, 3), np.uint8)
    for _ in range(_FILL_PX):
        farther = np.where(farther == _NOWHERE, cv2.dilate(farther, kernel), farther)
    for _ in range(_FROM_BEHIND_PX):
        farther = np.where(unknown & (farther > _NOWHERE), cv2.dilate(farther, kernel), farther)
    return np.where(farther == _NOWHERE, np.float32(np.nan), -farther)


def smoothed(disparity_px: Array) -> Array:
    """Take out the reference's noise and its steps, but no edge.

    A surface rough by a millimetre would otherwise shadow itself.
    """
    unknown = ~np.isfinite(disparity_px)
    smooth = cv2.bilateralFilter(np.where(unknown, -1e3, disparity_px), 9, 0.7, 3.0)
    return np.where(unknown, np.float32(np.nan), smooth).astype(np.float32)


def behind(disparity_px: Array) -> tuple[Array, NDArray[np.intp]]:
    """Continue each surface behind the one that ends in front of it.

    Returns:
        Disparity (h, w) of the continued surfaces, NaN where there is none, and the flat index
        (h, w) of the pixel that each was continued from.
    """
    far_edge = _far_side(disparity_px)
    _, labels = cv2.distanceTransformWithLabels(
        (~far_edge).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    distance = cv2.distanceTransform((~far_edge).astype(np.uint8), cv2.DIST_L2, 5)
    seeds = np.zeros(int(labels.max()) + 1, np.intp)
    nearest = np.asarray(labels, np.intp)
    seeds[nearest[far_edge]] = np.flatnonzero(far_edge)
    source = seeds[nearest]
    continued = disparity_px.ravel()[source]
    with np.errstate(invalid="ignore"):
        hidden = (disparity_px - continued > _JUMP_PX) & (distance <= _BEHIND_PX)
    return np.where(hidden | far_edge, continued, np.float32(np.nan)), source


def _far_side(disparity_px: Array) -> NDArray[np.bool_]:
    """Pixels that have something nearer right beside them."""
    padded = np.pad(disparity_px, 1, mode="edge")
    nearest = cv2.dilate(np.nan_to_num(padded, nan=-1e3), np.ones((3, 3), np.uint8))[1:-1, 1:-1]
    with np.errstate(invalid="ignore"):
        return nearest - disparity_px > _JUMP_PX


def triangles(
    disparity_px: Array,
    intrinsics: NDArray[np.float64],
    focal_baseline: float,
    *,
    jump_px: float = 1.5 * _JUMP_PX,
) -> Mesh:
    """Triangulate a disparity image in the left imager's frame.

    Args:
        disparity_px: (h, w), NaN where there is no surface.
        intrinsics: (3, 3) camera matrix of this image.
        focal_baseline: f b [px m].
        jump_px: squares of pixels whose disparities range wider are left open.

    Returns:
        Mesh with one vertex a known pixel, normals, and uv over the image.
    """
    height, width = disparity_px.shape
    v, u = np.mgrid[0:height, 0:width].astype(np.float32)
    u, v = u + np.float32(_OFFSET_PX[0]), v + np.float32(_OFFSET_PX[1])
    at_vertex = disparity_px.copy()
    for shift, axis in zip(_OFFSET_PX, (1, 0), strict=True):
        at_vertex += np.float32(shift) * _slope(disparity_px, disparity_px[..., None], axis)[..., 0]
    with np.errstate(invalid="ignore", divide="ignore"):
        z = (focal_baseline / at_vertex).astype(np.float32)
    x = (u - intrinsics[0, 2]) / intrinsics[0, 0] * z
    y = (v - intrinsics[1, 2]) / intrinsics[1, 1] * z
    points = np.stack([x, y, z], axis=-1).astype(np.float32)
    used = np.isfinite(disparity_px)
    number = np.cumsum(used).reshape(used.shape) - 1
    uv = np.stack([(u + 0.5) / width, (v + 0.5) / height], axis=-1)
    return Mesh(
        vertices=points[used],
        faces=_faces(disparity_px, number, jump_px),
        normals=_normals(disparity_px, points)[used],
        uv=uv[used].astype(np.float32),
    )


def _faces(disparity_px: Array, number: NDArray[np.intp], jump_px: float) -> NDArray[np.uint32]:
    """Two triangles a square of pixels, where its corners lie on one surface."""
    corners = [disparity_px[i : -1 + i or None, j : -1 + j or None] for i in (0, 1) for j in (0, 1)]
    with np.errstate(invalid="ignore"):
        whole = np.max(corners, axis=0) - np.min(corners, axis=0) <= jump_px
    a, b, c, d = (
        number[i : -1 + i or None, j : -1 + j or None][whole] for i in (0, 1) for j in (0, 1)
    )
    faces = np.concatenate([np.stack([a, c, b], axis=1), np.stack([b, c, d], axis=1)])
    return faces.astype(np.uint32)


def _normals(disparity_px: Array, points: Array) -> Array:
    """Unit normals towards the camera from differences that cross no edge."""
    along = [_slope(disparity_px, points, axis) for axis in (1, 0)]
    normal = np.cross(along[1], along[0])
    length = np.linalg.norm(normal, axis=-1, keepdims=True)
    facing = np.where(length > 0, normal / np.maximum(length, 1e-20), -points)
    facing /= np.maximum(np.linalg.norm(facing, axis=-1, keepdims=True), 1e-20)
    return np.nan_to_num(facing).astype(np.float32)


def _slope(disparity_px: Array, values: Array, axis: int) -> Array:
    """Change of `values` (h, w, n) a pixel along an axis, taken within each surface only."""
    total, count = np.zeros_like(values), np.zeros((*disparity_px.shape, 1), np.float32)
    with np.errstate(invalid="ignore"):
        for shift in (1, -1):
            same = np.abs(np.roll(disparity_px, -shift, axis) - disparity_px) <= _JUMP_PX
            ahead = (np.roll(values, -shift, axis) - values) * shift
            total += np.where(same[..., None], ahead, 0)
            count += same[..., None]
    return (total / np.maximum(count, 1)).astype(np.float32)
