"""Fusion of a stream's frames into one surface."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import trimesh

from starling.patterns import errors
from starling.sim.arrays import Image
from starling.sim.captures.exchange.stream import Moment
from starling.sim.captures.fusion import surface
from starling.sim.captures.fusion.trajectory import Posed
from starling.sim.captures.fusion.volume import Volume
from starling.sim.console import progress
from starling.sim.geometry.pinhole import Pinhole


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
    return surface.triangulate(volume, least=min(fusion.least, len(frames)))


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
