"""Kernels of a fused volume: block keys, block allocation and integration of depth images.

A block has 8 x 8 x 8 voxels; voxel (i, j, k) is at the point (i, j, k) times the voxel size. A
block's key packs its three block numbers into one integer.
"""

from __future__ import annotations

import numba as nb
import numpy as np
from numpy.typing import NDArray

EDGE = 8  # Voxels along an edge of a block.
_BITS = 21  # Bits of each block number in a key.
_ZERO = 1 << (_BITS - 1)  # Offset that makes block numbers positive.
_SPACING = 1 / 3  # Spacing of samples along a ray [blocks]; only corners of blocks are missed.

Keys = NDArray[np.int64]


def numbers(keys: Keys) -> NDArray[np.int64]:
    """Unpack keys (n,) to block numbers (n, 3)."""
    mask = (1 << _BITS) - 1
    parts = [(keys >> shift) & mask for shift in (2 * _BITS, _BITS, 0)]
    return np.stack(parts, axis=-1) - _ZERO


def keys_of(blocks: NDArray[np.int64]) -> Keys:
    """Pack block numbers (n, 3) to keys (n,), the inverse of `numbers`."""
    x, y, z = np.moveaxis(blocks + _ZERO, -1, 0)
    return (x << (2 * _BITS)) | (y << _BITS) | z


@nb.njit(nogil=True, cache=True)
def near(
    depth_m: NDArray[np.float32],
    lens: NDArray[np.float64],
    world_from_camera: NDArray[np.float64],
    block_m: float,
    band_m: float,
) -> Keys:
    """Return the keys of the blocks within a band around a depth image, with duplicates.

    Args:
        depth_m: z (h, w) [m], NaN = none.
        lens: fx, fy, cx, cy [px].
        world_from_camera: pose of the image.
        block_m: edge of a block [m].
        band_m: half width of the band along z [m].
    """
    height, width = depth_m.shape
    steps = 2 + int(2 * band_m / (_SPACING * block_m))
    keys = np.empty(height * width * steps, np.int64)
    count, last = 0, np.int64(-1)
    pose = world_from_camera
    for step in range(steps):
        shift = band_m * (2 * step / (steps - 1) - 1)
        for v in range(height):
            y = (v - lens[3]) / lens[1]
            for u in range(width):
                z = depth_m[v, u] + shift
                if not z > 0:
                    continue
                x = (u - lens[2]) / lens[0]
                key = np.int64(0)
                for axis in range(3):
                    row = pose[axis]
                    place = z * (row[0] * x + row[1] * y + row[2]) + row[3]
                    key = (key << _BITS) | (np.int64(np.floor(place / block_m)) + _ZERO)
                if key != last:
                    keys[count] = key
                    count += 1
                    last = key
    return keys[:count]


@nb.njit(nogil=True, cache=True)
def average_in(
    mean: NDArray[np.float32],
    count: NDArray[np.uint16],
    blocks: NDArray[np.int64],
    depth_m: NDArray[np.float32],
    lens: NDArray[np.float64],
    camera_from_world: NDArray[np.float64],
    voxel_m: float,
    band_m: float,
) -> None:
    """Average a depth image's truncated signed distances into voxels, in place.

    The signed distance of a voxel is the depth of its pixel minus the voxel's z, in units of the
    band. It is truncated to 1 in front of the surface. Voxels further behind the surface than the
    band are not updated.

    Args:
        mean: mean distances, (n, 8, 8, 8).
        count: numbers of averaged distances, (n, 8, 8, 8).
        blocks: block numbers (n, 3).
        depth_m, lens: as in `near`.
        camera_from_world: inverse pose of the image.
        voxel_m: edge of a voxel [m].
        band_m: as in `near`.
    """
    height, width = depth_m.shape
    pose = camera_from_world
    radius = 0.5 * np.sqrt(3.0) * EDGE * voxel_m
    for block in range(len(blocks)):
        corner = blocks[block] * (EDGE * voxel_m)
        centre = np.empty(3)
        for axis in range(3):
            middle = pose[axis, 3]
            for column in range(3):
                middle += pose[axis, column] * (corner[column] + 0.5 * EDGE * voxel_m)
            centre[axis] = middle
        if centre[2] < -radius or _outside(centre, radius, lens, height, width):
            continue
        for i in range(EDGE):
            for j in range(EDGE):
                for k in range(EDGE):
                    px = corner[0] + i * voxel_m
                    py = corner[1] + j * voxel_m
                    pz = corner[2] + k * voxel_m
                    z = pose[2, 0] * px + pose[2, 1] * py + pose[2, 2] * pz + pose[2, 3]
                    if z <= 0:
                        continue
                    x = pose[0, 0] * px + pose[0, 1] * py + pose[0, 2] * pz + pose[0, 3]
                    y = pose[1, 0] * px + pose[1, 1] * py + pose[1, 2] * pz + pose[1, 3]
                    u, v = lens[0] * x / z + lens[2], lens[1] * y / z + lens[3]
                    distance = (_sample(depth_m, u, v, band_m) - z) / band_m
                    if not distance >= -1:  # Behind the band, or NaN.
                        continue
                    seen = count[block, i, j, k]
                    if seen < 65535:
                        count[block, i, j, k] = seen + 1
                    share = 1 / (min(seen, 65534) + 1)
                    before = mean[block, i, j, k]
                    mean[block, i, j, k] = before + share * (min(distance, 1.0) - before)


@nb.njit(nogil=True, cache=True)
def _outside(
    centre: NDArray[np.float64], radius: float, lens: NDArray[np.float64], height: int, width: int
) -> bool:
    """Return True only if a sphere in front of the camera projects outside the image."""
    nearest = centre[2] - radius
    if nearest <= 1e-3:
        return False
    u, v = lens[0] * centre[0] / centre[2] + lens[2], lens[1] * centre[1] / centre[2] + lens[3]
    slope = (abs(centre[0]) + abs(centre[1])) / centre[2]
    wide = 2 * max(lens[0], lens[1]) * radius / nearest * (1 + slope)
    return u < -wide or v < -wide or u > width + wide or v > height + wide


@nb.njit(nogil=True, cache=True)
def _sample(depth_m: NDArray[np.float32], u: float, v: float, band_m: float) -> float:
    """Sample the depth image at a position; NaN without depth.

    Depth is bilinear between four pixels of one surface, and that of the nearest pixel at edges and
    holes.
    """
    height, width = depth_m.shape
    column, row = int(np.floor(u + 0.5)), int(np.floor(v + 0.5))
    if column < 0 or row < 0 or column >= width or row >= height:
        return np.nan
    nearest = depth_m[row, column]
    left, top = int(np.floor(u)), int(np.floor(v))
    if left < 0 or top < 0 or left + 1 >= width or top + 1 >= height:
        return nearest
    a, b = depth_m[top, left], depth_m[top, left + 1]
    c, d = depth_m[top + 1, left], depth_m[top + 1, left + 1]
    if not max(max(a, b), max(c, d)) - min(min(a, b), min(c, d)) <= band_m:
        return nearest
    across, down = u - left, v - top
    upper, lower = a + across * (b - a), c + across * (d - c)
    return upper + down * (lower - upper)
