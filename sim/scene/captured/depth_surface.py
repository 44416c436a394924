"""Scene from reference depth: the surface seen by a camera, cut and continued at its edges."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.sim.arrays import Image, Mask
from starling.sim.captures.info import CaptureInfo
from starling.sim.scene.captured.room_light import LIT_ROOM_W_M2
from starling.sim.scene.scene import Ambient, Body, Material, Mesh, Scene

_PATCHED_PX = 8.0  # Largest step that is meshed over on continued surfaces [px].
_MARGIN_PX = 128  # Columns added at each side, for regions that only the right imager sees [px].
_ROWS_PX = 16  # Rows added above and below; lens blur would darken the outermost rows [px].
_SOFT_PX = 9  # Side of the square whose mean reflectance a continued surface takes [px].
_NOISY_SURFACE = 0.01  # Shadow tolerance of surfaces measured with noise.

_JUMP_PX = 1.0  # A larger disparity difference of neighbours separates surfaces [px].
_NOWHERE = np.float32(-1e6)  # Marks unknown pixels.
_FROM_BEHIND_PX = 4  # Distance by which a hole's far side grows over its near side [px].
_FILL_PX = 24  # Half the largest width of holes that are closed [px].
# Vertices lie off the pixel centres and diagonals, since a ray through a vertex or an edge of two
# triangles can miss both.
_OFFSET_PX = (0.13, 0.07)
_BEHIND_PX = 64  # Length by which a surface continues behind a nearer one [px].


def scene(
    name: str,
    disparity_px: Image,
    info: CaptureInfo,
    material: Material,
    *,
    reflectance: Image | None = None,
    ambient_w_m2: float = LIT_ROOM_W_M2,
    ambient_share: Image | None = None,
) -> Scene:
    """Build a scene from reference disparity: filled, smoothed, and continued behind edges.

    Args:
        name: Name of the scene.
        disparity_px: (h, w) for the captures' focal length and baseline, NaN where unknown.
        info: Information of the captures.
        material: Material of all surfaces.
        reflectance: (h, w) in the left view; replaces the material's. It may include shading.
        ambient_w_m2: Irradiance of ambient light [W m^-2].
        ambient_share: (h, w) local ambient light relative to `ambient_w_m2`; None: 1 everywhere.
    """
    sides = ((_ROWS_PX, _ROWS_PX), (_MARGIN_PX, _MARGIN_PX))
    front_px = np.pad(smooth(close_holes(disparity_px)), sides, mode="edge")
    hidden_px, source = continue_behind(front_px)

    def texture_pair(image: Image | None) -> tuple[Image | None, Image | None]:
        """Image values on the surface and on the continued surface behind it."""
        if image is None:
            return None, None
        front = np.pad(image, sides, mode="reflect")
        soft = np.asarray(cv2.blur(front, (_SOFT_PX, _SOFT_PX)), np.float32)
        return front, soft.ravel()[source]

    front, back = texture_pair(reflectance)
    lit_front, lit_back = texture_pair(ambient_share)
    cx, cy = info.cx_px + _MARGIN_PX, info.cy_px + _ROWS_PX
    intrinsics = np.array([[info.fx_px, 0, cx], [0, info.fy_px, cy], [0, 0, 1]])
    parts = (
        ("surface", front_px, {}, front, lit_front),
        ("surface behind", hidden_px, {"jump_px": _PATCHED_PX}, back, lit_back),
    )
    return Scene(
        name=name,
        bodies=tuple(
            Body(
                name=part,
                mesh=triangulate(disparity, intrinsics, info.focal_baseline_px_m, **limit),
                material=material,
                texture=texture,
                ambient_share=share,
            )
            for part, disparity, limit, texture, share in parts
            if np.isfinite(disparity).any()
        ),
        ambient=Ambient(irradiance_w_m2=ambient_w_m2, gradient=0.0),
        shadow_tolerance=_NOISY_SURFACE,
    )


def close_holes(disparity_px: Image) -> Image:
    """Fill thin holes with the farthest adjacent surface, since holes mostly lie behind edges.

    Args:
        disparity_px: (h, w), NaN where unknown.

    Returns:
        The filled map, NaN beyond 24 px from known pixels.
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


def smooth(disparity_px: Image) -> Image:
    """Remove noise and quantisation steps of the reference, but keep its edges.

    A surface with a roughness of a millimetre would shadow itself.
    """
    unknown = ~np.isfinite(disparity_px)
    smooth = cv2.bilateralFilter(np.where(unknown, -1e3, disparity_px), 9, 0.7, 3.0)
    return np.where(unknown, np.float32(np.nan), smooth).astype(np.float32)


def continue_behind(disparity_px: Image) -> tuple[Image, NDArray[np.intp]]:
    """Continue each surface behind the nearer surface that ends in front of it.

    Returns:
        Disparity (h, w) of the continued surfaces, NaN where there is none. Flat index (h, w) of
        the pixel from which each value was continued.
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


def _far_side(disparity_px: Image) -> Mask:
    """Pixels adjacent to a nearer surface."""
    padded = np.pad(disparity_px, 1, mode="edge")
    nearest = cv2.dilate(np.nan_to_num(padded, nan=-1e3), np.ones((3, 3), np.uint8))[1:-1, 1:-1]
    with np.errstate(invalid="ignore"):
        return nearest - disparity_px > _JUMP_PX


def triangulate(
    disparity_px: Image,
    intrinsics: NDArray[np.float64],
    focal_baseline: float,
    *,
    jump_px: float = 1.5 * _JUMP_PX,
) -> Mesh:
    """Triangulate a disparity image in the left imager's frame.

    Args:
        disparity_px: (h, w), NaN where there is no surface.
        intrinsics: (3, 3) camera matrix.
        focal_baseline: f b [px m].
        jump_px: Pixel squares with a larger range of disparities get no triangles [px].

    Returns:
        Mesh with one vertex per known pixel, normals, and uv over the image.
    """
    height, width = disparity_px.shape
    v, u = np.mgrid[0:height, 0:width].astype(np.float32)
    u, v = u + np.float32(_OFFSET_PX[0]), v + np.float32(_OFFSET_PX[1])
    vertex_px = disparity_px.copy()
    for shift, axis in zip(_OFFSET_PX, (1, 0), strict=True):
        vertex_px += np.float32(shift) * _slope(disparity_px, disparity_px[..., None], axis)[..., 0]
    with np.errstate(invalid="ignore", divide="ignore"):
        z = (focal_baseline / vertex_px).astype(np.float32)
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


def _faces(disparity_px: Image, number: NDArray[np.intp], jump_px: float) -> NDArray[np.uint32]:
    """Two triangles per pixel square whose corners lie on one surface."""
    corners = [disparity_px[i : -1 + i or None, j : -1 + j or None] for i in (0, 1) for j in (0, 1)]
    with np.errstate(invalid="ignore"):
        whole = np.max(corners, axis=0) - np.min(corners, axis=0) <= jump_px
    a, b, c, d = (
        number[i : -1 + i or None, j : -1 + j or None][whole] for i in (0, 1) for j in (0, 1)
    )
    faces = np.concatenate([np.stack([a, c, b], axis=1), np.stack([b, c, d], axis=1)])
    return faces.astype(np.uint32)


def _normals(disparity_px: Image, points: Image) -> Image:
    """Unit normals towards the camera, from differences within surfaces."""
    along = [_slope(disparity_px, points, axis) for axis in (1, 0)]
    normal = np.cross(along[1], along[0])
    length = np.linalg.norm(normal, axis=-1, keepdims=True)
    facing = np.where(length > 0, normal / np.maximum(length, 1e-20), -points)
    facing /= np.maximum(np.linalg.norm(facing, axis=-1, keepdims=True), 1e-20)
    return np.nan_to_num(facing).astype(np.float32)


def _slope(disparity_px: Image, values: Image, axis: int) -> Image:
    """Change of `values` (h, w, n) per pixel along an axis, within each surface."""
    total, count = np.zeros_like(values), np.zeros((*disparity_px.shape, 1), np.float32)
    with np.errstate(invalid="ignore"):
        for shift in (1, -1):
            same = np.abs(np.roll(disparity_px, -shift, axis) - disparity_px) <= _JUMP_PX
            ahead = (np.roll(values, -shift, axis) - values) * shift
            total += np.where(same[..., None], ahead, 0)
            count += same[..., None]
    return (total / np.maximum(count, 1)).astype(np.float32)
