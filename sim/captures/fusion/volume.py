"""Fusion of depth images into one surface: a truncated signed distance field near surfaces.

Source: Curless and Levoy, A volumetric method for building complex models from range images,
SIGGRAPH 1996 (all weights 1). Blocks are found by key as in Niessner et al., Real-time 3D
reconstruction at scale using voxel hashing, SIGGRAPH Asia 2013.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

from starling.patterns import errors
from starling.sim.arrays import Image
from starling.sim.captures.exchange.stream import Moment, Posed
from starling.sim.captures.fusion import blocks
from starling.sim.console import progress
from starling.sim.geometry.frames import Pose
from starling.sim.geometry.pinhole import Pinhole

_MOST = 1_000_000  # Largest number of blocks (3 GB).
_BAND_VOXELS = 4.0  # Default truncation distance, at least [voxels].
_BAND_M = 0.03  # Default truncation distance, at least [m]: 3 sigma of depth noise at 2 m.
_WIDEST = 16  # Largest truncation distance [voxels].
_TILE = 4  # Blocks along an edge of a tile; tiles are triangulated one by one to save memory.
_WIDE = _TILE * blocks.EDGE + 1  # Voxels along a tile, including the next tile's first voxel.
_LEAST_SHARE = 1e-3  # Vertices closer than this are merged [voxels].


@dataclass(frozen=True, kw_only=True, slots=True)
class Fusion:
    """Settings of the fusion of streams."""

    voxel_m: float = 5e-3  # Edge of a voxel [m].
    band_m: float | None = None  # Truncation distance [m]; None uses the default of `Volume`.
    far_m: float = 3.0  # Depth beyond it is not fused [m].
    every: int = 1  # One frame out of this many is used.
    least: int = 2  # Frames that must observe a voxel; all frames if there are fewer.

    def __post_init__(self) -> None:
        errors.in_interval("far", self.far_m, 0.1, 12.0, "Give it [m].")
        errors.in_interval("least", self.least, 1, 10**4, "Give a number of frames.")


def fuse_frames(
    frames: Sequence[Posed],
    camera: Pinhole,
    fusion: Fusion,
    *,
    track: progress.Progress = progress.silent,
) -> trimesh.Trimesh:
    """Fuse frames and triangulate the surface.

    Args:
        frames: frames of one static room.
        camera: intrinsics of all frames.
        fusion: settings.
        track: wraps the loop over frames.

    Raises:
        InputError: if a depth image has not the camera's size, or there is no surface.
    """
    volume = Volume(camera, fusion.voxel_m, fusion.band_m)
    for posed in track(frames, "fuse"):
        depth_m = depth_of(posed.moment, camera)
        near = np.where(depth_m <= fusion.far_m, depth_m, np.float32(np.nan))
        volume.add(near, posed.world_from_camera)
    return triangulate(volume, least=min(fusion.least, len(frames)))


def depth_of(moment: Moment, camera: Pinhole) -> Image:
    """Read the depth z (h, w) [m] of a moment, NaN = none.

    Raises:
        InputError: if it has not the camera's size or cannot be read.
    """
    depth_m = moment.depth()
    if depth_m.shape != (camera.height, camera.width):
        height, width = depth_m.shape
        rule = f"must be {camera.width}x{camera.height} as the camera"
        actual = f"{width}x{height} at {moment.time_s:.6f} s"
        raise errors.refuse("depth", rule, actual, "Give the depth images' camera.")
    return depth_m


class Volume:
    """Truncated signed distances fused from depth images of one camera, in the world frame [m]."""

    def __init__(self, camera: Pinhole, voxel_m: float, band_m: float | None = None) -> None:
        """Create an empty volume.

        Args:
            camera: intrinsics of all images.
            voxel_m: edge of a voxel [m].
            band_m: truncation distance [m], larger than the depth noise. None uses 30 mm or 4
                voxels, whichever is larger.

        Raises:
            InputError: if the edge is not 0.5 mm to 10 cm, or the band not 1.5 to 16 voxels.
        """
        errors.in_interval("voxel", voxel_m, 5e-4, 0.1, "Give the voxel's edge [m].")
        self.voxel_m = voxel_m
        usual_m = min(max(_BAND_VOXELS * voxel_m, _BAND_M), _WIDEST * voxel_m)
        self.band_m = usual_m if band_m is None else band_m
        advice = "Give it [m]: four voxels, more where the depth is noisy."
        errors.in_interval("band", self.band_m, 1.5 * voxel_m, _WIDEST * voxel_m, advice)
        self.camera = camera
        self._lens = np.array([camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px])
        self._count = 0
        self._keys = np.zeros(0, np.int64)
        self._mean = np.zeros((0, *(blocks.EDGE,) * 3), np.float32)
        self._seen = np.zeros(self._mean.shape, np.uint16)

    def add(self, depth_m: NDArray[np.float32], world_from_camera: Pose) -> None:
        """Fuse one depth image.

        Args:
            depth_m: z (h, w) [m], NaN = none.
            world_from_camera: pose of the image.

        Raises:
            InputError: if the volume would need too many blocks.
        """
        depth_m = np.ascontiguousarray(depth_m, np.float32)
        pose = np.ascontiguousarray(world_from_camera, np.float64)
        block_m = blocks.EDGE * self.voxel_m
        self._allocate(np.unique(blocks.near(depth_m, self._lens, pose, block_m, self.band_m)))
        blocks.average_in(
            self._mean[: self._count],
            self._seen[: self._count],
            blocks.numbers(self.keys),
            depth_m,
            self._lens,
            np.asarray(np.linalg.inv(pose), np.float64),
            self.voxel_m,
            self.band_m,
        )

    @property
    def keys(self) -> blocks.Keys:
        """Keys of the allocated blocks (n,), see `starling.sim.captures.fusion.blocks`."""
        return self._keys[: self._count]

    @property
    def mean(self) -> NDArray[np.float32]:
        """Mean signed distance in units of the band, > 0 in front of surfaces, (n, 8, 8, 8)."""
        return self._mean[: self._count]

    @property
    def seen(self) -> NDArray[np.uint16]:
        """Number of images that each voxel's mean includes, (n, 8, 8, 8)."""
        return self._seen[: self._count]

    def _allocate(self, keys: blocks.Keys) -> None:
        new = np.setdiff1d(keys, self.keys, assume_unique=True)
        count = self._count + len(new)
        if count > _MOST:
            advice = "Use larger voxels, or a smaller --far."
            raise errors.refuse("volume", f"must have at most {_MOST} blocks", count, advice)
        if count > len(self._keys):
            room = min(max(count, 2 * len(self._keys)), _MOST) - len(self._keys)
            self._keys = np.concatenate([self._keys, np.zeros(room, np.int64)])
            empty = (room, *(blocks.EDGE,) * 3)
            self._mean = np.concatenate([self._mean, np.zeros(empty, np.float32)])
            self._seen = np.concatenate([self._seen, np.zeros(empty, np.uint16)])
        self._keys[self._count : count] = new
        self._count = count


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
