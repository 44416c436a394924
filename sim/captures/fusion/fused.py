"""The one surface that all frames of a stream see."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import trimesh

from starling.patterns import errors
from starling.sim.captures.exchange.stream import Moment
from starling.sim.captures.fusion import surface
from starling.sim.captures.fusion.trajectory import Posed
from starling.sim.captures.fusion.volume import Volume
from starling.sim.console import progress
from starling.sim.geometry.pinhole import Pinhole
from starling.sim.render.layers import Image


@dataclass(frozen=True, kw_only=True, slots=True)
class Fusion:
    """How streams are fused."""

    voxel_m: float = 5e-3
    band_m: float | None = (
        None  # Where a surface's field ends; None: see `starling.sim.captures.fusion.volume`.
    )
    far_m: float = 3.0  # Depth beyond it is not fused.
    every: int = 1  # Of so many frames one is taken.
    least: int = 2  # Frames that must have seen a place; all where there are fewer.

    def __post_init__(self) -> None:
        errors.in_interval("far", self.far_m, 0.1, 12.0, "Give it [m].")
        errors.in_interval("least", self.least, 1, 10**4, "Give a number of frames.")


def fused(
    frames: Sequence[Posed],
    camera: Pinhole,
    fusion: Fusion,
    *,
    track: progress.Progress = progress.silent,
) -> trimesh.Trimesh:
    """Fuse frames and triangulate the surface.

    Args:
        frames: of one static room.
        camera: of all of them.
        fusion: how.
        track: wraps the loop over frames.

    Raises:
        InputError: if a depth image is not of the camera's size, or there is no surface.
    """
    volume = Volume(camera, fusion.voxel_m, fusion.band_m)
    for one in track(frames, "fuse"):
        depth_m = depth_of(one.moment, camera)
        near = np.where(depth_m <= fusion.far_m, depth_m, np.float32(np.nan))
        volume.add(near, one.world_from_camera)
    return surface.of(volume, least=min(fusion.least, len(frames)))


def depth_of(moment: Moment, camera: Pinhole) -> Image:
    """Depth z (h, w) [m] of a moment, NaN = none.

    Raises:
        InputError: if it is not of the camera's size, or cannot be read.
    """
    depth_m = moment.depth()
    if depth_m.shape != (camera.height, camera.width):
        height, width = depth_m.shape
        rule = f"must be {camera.width}x{camera.height} as the camera"
        at = f"{width}x{height} at {moment.time_s:.6f} s"
        raise errors.refuse("depth", rule, at, "Give the depth images' camera.")
    return depth_m
