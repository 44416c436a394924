"""A stream's frames as scenes of a capture set, with the device's depth and the surface's."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

from starling.patterns import errors
from starling.sim.arrays import Image
from starling.sim.captures import writer
from starling.sim.captures.exchange import tum
from starling.sim.captures.exchange.stream import Posed
from starling.sim.captures.fusion.volume import depth_of
from starling.sim.captures.info import CaptureInfo
from starling.sim.captures.png import GreyImage
from starling.sim.console import progress
from starling.sim.console.output import Folder
from starling.sim.geometry.frames import Pose
from starling.sim.geometry.pinhole import Pinhole
from starling.sim.reason import Reason
from starling.sim.render import backend, plugin_scene
from starling.sim.render.mitsuba_scene import MitsubaScene
from starling.sim.render.rays import cameras, pixels
from starling.sim.scene.builtin import solids
from starling.sim.scene.scene import Material, Scene
from starling.sim.sensor import presets
from starling.sim.sensor.sensor import Sensor
from starling.sim.stereo.depth import DepthMap

UNIT_M = tum.UNIT_M  # A fifth of a millimetre, so that depths of all layouts are whole codes [m].
_LARGEST_M = 65535 * UNIT_M  # Largest depth that the 16-bit code represents [m].

_SEEN = "p:position,n:geo_normal"
_Traced = tuple[NDArray[np.float64], NDArray[np.float64]]  # Points and normals, 0 without a hit.


def write(
    name: str,
    frames: Sequence[Posed],
    mesh: trimesh.Trimesh,
    info: CaptureInfo,
    folder: Folder,
    *,
    track: progress.Progress = progress.silent,
) -> dict[str, float | None]:
    """Write each frame as a scene NAME-000012 of one room.

    Args:
        name: name of the room.
        frames: frames to write.
        mesh: surface in the frames' world frame.
        info: camera of the set.
        folder: output folder.
        track: wraps the loop over frames.

    Returns:
        `{"completeness", "residual_m", "ndp"}`. `completeness` is the mean share of pixels with
        reference depth. `residual_m` is the median over frames of the median |device - reference|.
        `ndp` is the mean share of pixels with reference depth that lack device depth. None without
        such pixels.

    Raises:
        InputError: if an image is damaged, or a grey image has not the camera's size.
    """
    camera = Pinhole.from_camera(info)
    references = reference_depths(mesh, camera, [posed.world_from_camera for posed in frames])
    complete: list[float] = []
    residual_m: list[float] = []
    ndp: list[float] = []
    for posed in track(frames, "pair"):
        truth_m, depth_m = next(references), depth_of(posed.moment, camera)
        _write_scene(f"{name}-{posed.number:06d}", name, posed, truth_m, depth_m, info, folder)
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
    posed: Posed,
    truth_m: Image,
    depth_m: Image,
    info: CaptureInfo,
    folder: Folder,
) -> None:
    grey, colour = _pictures(posed, info)
    writer.write_scene(folder, scene, room=room, truth_m=truth_m, depth_unit_m=UNIT_M)
    facts: dict[str, Any] = {
        "timestamp": posed.moment.time_s,
        "left_from_world": np.linalg.inv(posed.world_from_camera).tolist(),
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


def _pictures(posed: Posed, info: CaptureInfo) -> tuple[GreyImage | None, NDArray[Any] | None]:
    """Read the moment's image: (grey, None) as infrared, or (None, colour)."""
    if posed.moment.image is None:
        return None, None
    image = posed.moment.image()
    if image.ndim == 3:
        return None, image
    if image.shape != info.shape:
        height, width = image.shape
        rule = f"must be {info.width}x{info.height} as the depth"
        actual = f"{width}x{height} at {posed.moment.time_s:.6f} s"
        raise errors.refuse("grey image", rule, actual, "Remove the images of another camera.")
    return image, None


def _device(depth_m: Image, info: CaptureInfo) -> DepthMap:
    """Return the device's depth map; depth beyond the code's range is clipped, not missing."""
    clipped_m = np.minimum(depth_m, np.float32(_LARGEST_M))
    valid = np.isfinite(clipped_m)
    return DepthMap(
        disparity_px=info.disparity_px(clipped_m),
        depth_m=clipped_m,
        valid=valid,
        reason=np.where(valid, Reason.VALID, Reason.UNKNOWN).astype(np.uint32),
    )


def reference_depths(
    mesh: trimesh.Trimesh, camera: Pinhole, poses: Sequence[Pose]
) -> Iterator[Image]:
    """Trace z (h, w) [m] at each pose, NaN where no front side of the surface is visible.

    A back side is visible only through a hole in the front, so its depth is not used.

    Args:
        mesh: surface in the world frame [m].
        camera: intrinsics of the images.
        poses: `world_from_camera` of each image.

    Raises:
        InputError: if the mesh is not in metres, or the camera's pixels are not square (scalar
            variant only).
    """
    body = solids.body("fused", mesh, Material(name="fused"))
    stage = MitsubaScene(Scene(name="fused", bodies=(body,), world_from_left=poses[0]))
    lens = dataclasses.replace(presets.load("d435"), **dataclasses.asdict(camera))
    traced = _compiled if backend.is_jit() else _scalar
    for pose in poses:
        point, normal = traced(stage, lens, pose)
        away = point - pose[:3, 3]
        front = (normal * away).sum(axis=-1) < 0
        yield np.where(front, away @ pose[:3, 2], np.nan).astype(np.float32)


def _compiled(stage: MitsubaScene, lens: Sensor, pose: Pose) -> _Traced:
    dr = backend.drjit()
    eye, _ = cameras(lens, pose)
    si = stage.mitsuba.ray_intersect(eye.ray(pixels(eye.size)))
    normal = dr.select(si.is_valid(), si.n, 0)
    dr.eval(si.p, normal)
    shape = (*eye.size[::-1], 3)
    point, normal = (np.array(vectors, np.float64).T.reshape(shape) for vectors in (si.p, normal))
    return point, normal


def _scalar(stage: MitsubaScene, lens: Sensor, pose: Pose) -> _Traced:
    mi = backend.mitsuba()
    eye = plugin_scene.camera(lens, pose, sampler=plugin_scene.fixed(1))
    integrator = mi.load_dict({"type": "aov", "aovs": _SEEN})
    image = np.array(mi.render(stage.mitsuba, sensor=eye, integrator=integrator, spp=1), np.float64)
    return image[..., :3], image[..., 3:6]
