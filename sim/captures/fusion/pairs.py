"""A stream's frames as scenes of a capture set: the device's depth, and the surface's."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

from starling.patterns import errors
from starling.sim.captures import writer
from starling.sim.captures.exchange import tum
from starling.sim.captures.fusion import reference
from starling.sim.captures.fusion.fused import depth_of
from starling.sim.captures.fusion.trajectory import Posed
from starling.sim.captures.info import CaptureInfo
from starling.sim.captures.png import GreyImage
from starling.sim.console import progress
from starling.sim.console.output import Folder
from starling.sim.geometry.pinhole import Pinhole
from starling.sim.reason import Reason
from starling.sim.render.layers import Image
from starling.sim.stereo.depth import DepthMap

UNIT_M = tum.UNIT_M  # A millimetre has five: depths of all layouts are whole codes.
_LARGEST_M = 65535 * UNIT_M


def write(
    name: str,
    frames: Sequence[Posed],
    mesh: trimesh.Trimesh,
    info: CaptureInfo,
    folder: Folder,
    *,
    track: progress.Progress = progress.silent,
) -> dict[str, float | None]:
    """Write each frame as a scene, NAME-000012, all of one room.

    Args:
        name: the room's.
        frames: that are written.
        mesh: surface in their world.
        info: of the set.
        folder: where to.
        track: wraps the loop over frames.

    Returns:
        `{"completeness", "residual_m", "ndp"}`: mean share of pixels that have reference depth;
        median over frames of the median |device - reference|; mean share of the pixels with
        reference depth that have none of the device's. None where there is no such pixel.

    Raises:
        InputError: if an image is damaged, or a grey one not of the camera's size.
    """
    camera = Pinhole.of(info)
    seen = reference.depths(mesh, camera, [one.world_from_camera for one in frames])
    complete: list[float] = []
    residual_m: list[float] = []
    ndp: list[float] = []
    for one in track(frames, "pair"):
        truth_m, depth_m = next(seen), depth_of(one.moment, camera)
        _write_scene(f"{name}-{one.number:06d}", name, one, truth_m, depth_m, info, folder)
        known, both = np.isfinite(truth_m), np.isfinite(truth_m) & np.isfinite(depth_m)
        complete.append(float(known.mean()))
        if known.any():
            ndp.append(float(1 - both.sum() / known.sum()))
        if both.any():
            residual_m.append(float(np.median(np.abs(depth_m - truth_m)[both])))
    return {
        "completeness": float(np.mean(complete)),
        "residual_m": float(np.median(residual_m)) if residual_m else None,
        "ndp": float(np.mean(ndp)) if ndp else None,
    }


def _write_scene(
    scene: str,
    room: str,
    one: Posed,
    truth_m: Image,
    depth_m: Image,
    info: CaptureInfo,
    folder: Folder,
) -> None:
    grey, colour = _pictures(one, info)
    writer.write_scene(folder, scene, room=room, truth_m=truth_m, depth_unit_m=UNIT_M)
    facts: dict[str, Any] = {
        "timestamp": one.moment.time_s,
        "left_from_world": np.linalg.inv(one.world_from_camera).tolist(),
        "counts": "repeats",
    }
    writer.write_frame(
        folder,
        scene,
        0,
        depth=_device(depth_m, info),
        depth_unit_m=UNIT_M,
        infrared=None if grey is None else (grey, None),
        colour=colour,
        facts=facts,
    )


def _pictures(one: Posed, info: CaptureInfo) -> tuple[GreyImage | None, NDArray[Any] | None]:
    """The moment's image as infrared where it is grey, as colour where it is that."""
    if one.moment.image is None:
        return None, None
    image = one.moment.image()
    if image.ndim == 3:
        return None, image
    if image.shape != info.shape:
        height, width = image.shape
        rule = f"must be {info.width}x{info.height} as the depth"
        at = f"{width}x{height} at {one.moment.time_s:.6f} s"
        raise errors.refuse("grey image", rule, at, "Leave out what is of another camera.")
    return image, None


def _device(depth_m: Image, info: CaptureInfo) -> DepthMap:
    """What the device told; beyond what the code can say it is still no hole."""
    told_m = np.minimum(depth_m, np.float32(_LARGEST_M))
    valid = np.isfinite(told_m)
    return DepthMap(
        disparity_px=info.disparity_px(told_m),
        depth_m=told_m,
        valid=valid,
        reason=np.where(valid, Reason.VALID, Reason.UNKNOWN).astype(np.uint32),
    )
