"""Triangulation of a fused volume's zero surface."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

from starling.patterns import errors
from starling.sim.captures.fusion import blocks
from starling.sim.captures.fusion.volume import Volume

_TILE = 4  # Blocks along an edge of a tile; tiles are triangulated one by one to save memory.
_WIDE = _TILE * blocks.EDGE + 1  # Voxels along a tile, including the next tile's first voxel.
_LEAST_SHARE = 1e-3  # Vertices closer than this are merged [voxels].


def triangulate(volume: Volume, *, least: int = 1) -> trimesh.Trimesh:
    """Triangulate the zero crossing of the mean distance between observed voxels.

    Holes are not closed: there is no surface where no camera looked.

    Args:
        volume: volume with fused depth images.
        least: images that must observe a voxel.

    Returns:
        Mesh in the world frame [m]; its front faces the cameras.

    Raises:
        InputError: if there is no surface, or scikit-image is not installed.
    """
    marching_cubes = _marching_cubes()
    points, faces, count = [], [], 0
    for corner, field in _tiles(volume, least):
        cells = _crossed(field)
        if not cells.any():
            continue
        mask = np.zeros(field.shape, bool)
        mask[1:, 1:, 1:] = cells  # scikit-image indexes a cell by its last voxel.
        vertices, triangles, _, _ = marching_cubes(np.nan_to_num(field), 0.0, mask=mask)
        points.append((vertices.astype(np.float64) + corner) * volume.voxel_m)
        faces.append(triangles + count)
        count += len(vertices)
    if not points:
        advice = "Are the depths, their unit and the poses right?"
        raise errors.refuse("surface", "must be seen", f"{len(volume.keys)} blocks", advice)
    mesh = trimesh.Trimesh(np.concatenate(points), np.concatenate(faces), process=False)
    digits = int(np.ceil(-np.log10(_LEAST_SHARE * volume.voxel_m)))
    mesh.merge_vertices(digits_vertex=digits)
    mesh.update_faces(mesh.nondegenerate_faces())
    mesh.remove_unreferenced_vertices()
    return mesh


def refuse_without() -> None:
    """Check that surfaces can be triangulated, before any work is done.

    Raises:
        InputError: if scikit-image is not installed.
    """
    _marching_cubes()


def _marching_cubes() -> Any:
    try:
        from skimage.measure import marching_cubes
    except ImportError as error:
        raise errors.needs("surface", "scikit-image", "data") from error
    return marching_cubes


def _tiles(volume: Volume, least: int) -> Iterator[tuple[NDArray[np.int64], NDArray[np.float32]]]:
    """Yield the first voxel of each tile and its distances, NaN where unobserved."""
    where = blocks.numbers(volume.keys)
    slots = {key: slot for slot, key in enumerate(volume.keys.tolist())}
    offsets = np.stack(np.meshgrid(*[np.arange(_TILE + 1)] * 3, indexing="ij"), -1).reshape(-1, 3)
    for tile in np.unique(where // _TILE, axis=0):
        field = np.full((_WIDE,) * 3, np.nan, np.float32)
        near = blocks.keys_of(tile * _TILE + offsets).tolist()
        for offset, key in zip(offsets, near, strict=True):
            slot = slots.get(key)
            if slot is None:
                continue
            x, y, z = offset * blocks.EDGE
            part = field[x : x + blocks.EDGE, y : y + blocks.EDGE, z : z + blocks.EDGE]
            known = np.where(volume.seen[slot] >= least, volume.mean[slot], np.float32(np.nan))
            part[...] = known[: part.shape[0], : part.shape[1], : part.shape[2]]
        yield tile * (_TILE * blocks.EDGE), field


def _crossed(field: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Mask of cells with eight observed voxels that the surface crosses, (n - 1) per axis."""
    first, rest = slice(None, -1), slice(1, None)
    corners = [field[a, b, c] for a in (first, rest) for b in (first, rest) for c in (first, rest)]
    low, high = corners[0], corners[0]
    for corner in corners[1:]:  # Minima and maxima propagate NaN.
        low, high = np.minimum(low, corner), np.maximum(high, corner)
    return (low <= 0) & (high > 0)  # As in scikit-image, 0 counts as behind the surface.
