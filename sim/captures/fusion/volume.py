"""A truncated signed distance field, stored only near surfaces.

Source: Curless and Levoy, A volumetric method for building complex models from range images,
SIGGRAPH 1996 (all weights 1). Blocks are found by key as in Niessner et al., Real-time 3D
reconstruction at scale using voxel hashing, SIGGRAPH Asia 2013.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from starling.patterns import errors
from starling.sim.captures.fusion import blocks
from starling.sim.geometry.frames import Pose
from starling.sim.geometry.pinhole import Pinhole

_MOST = 1_000_000  # Largest number of blocks (3 GB).
_BAND_VOXELS = 4.0  # Default truncation distance, at least [voxels].
_BAND_M = 0.03  # Default truncation distance, at least [m]: 3 sigma of depth noise at 2 m.
_WIDEST = 16  # Largest truncation distance [voxels].


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
