"""The work of `starling fuse`: RGB-D streams in, a capture set with reference depth out."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np

from starling.patterns import errors
from starling.sim.captures import writer
from starling.sim.captures.exchange import labelfusion, tum
from starling.sim.captures.exchange.stream import Stream
from starling.sim.captures.fusion import pairs, surface, trajectory
from starling.sim.captures.fusion.fused import Fusion, fused
from starling.sim.captures.info import CaptureInfo
from starling.sim.console import progress
from starling.sim.console.output import Folder, OutputFolder, refuse_own_input
from starling.sim.geometry.pinhole import Pinhole
from starling.sim.render import backend
from starling.sim.sensor import presets

Layout = Literal["tum", "labelfusion"]


def fuse(
    streams: Sequence[Path],
    out: Path,
    *,
    layout: Layout,
    camera: str = "",
    sensor: str = "kinect-v1",
    fusion: Fusion | None = None,
    force: bool = False,
    track: progress.Progress = progress.silent,
) -> dict[str, Any]:
    """Fuse streams, each to its surface, and pair each frame with the surface's depth.

    Args:
        streams: folders, each of one static room, all of one camera.
        out: folder of the capture set: a scene each frame, a room each stream, NAME.ply.
        layout: of the streams.
        camera: `fx fy cx cy width height`; empty takes what the streams say.
        sensor: preset of the device, for its name and baseline.
        fusion: how; None takes what is usual.
        force: replace what was made before.
        track: wraps loops over frames.

    Returns:
        `{"out", "frames", "without_pose", "points", "triangles", "voxel_m", "streams",
        "seconds"}`, in `streams` by name the same and the figures of `starling.sim.captures.fusion.pairs`.

    Raises:
        InputError: whatever is wrong with streams, poses, camera or the folder; nothing is left.
    """
    started = time.perf_counter()
    fusion = fusion or Fusion()
    surface.refuse_without()
    opened = _opened(streams, layout, parsed(camera) if camera else None)
    for path in streams:
        refuse_own_input(out, path)
    device = presets.load(sensor)
    info = CaptureInfo(
        **dataclasses.asdict(next(iter(opened.values())).camera),
        sensor=device.name,
        baseline_m=device.baseline_m,
        depth_unit_m=pairs.UNIT_M,
        source=f"{layout}: {', '.join(opened)}",
        licence="as the streams'",
        notes="truth.png: the surface fused of all frames' depth.png, from where each was taken",
    )
    with OutputFolder(out, force=force) as folder:
        told = {name: _one(name, opened[name], info, fusion, folder, track) for name in opened}
        counted = ("frames", "without_pose", "points", "triangles")
        figures = {
            **{key: sum(one[key] for one in told.values()) for key in counted},
            "voxel_m": fusion.voxel_m,
            "streams": told,
        }
        arguments = {
            "streams": [str(path) for path in streams],
            **{"layout": layout, "camera": camera, "sensor": sensor},
            **dataclasses.asdict(fusion),
        }
        writer.write_set(
            folder,
            info,
            info.geometry_into(device),
            verb="fuse",
            arguments=arguments,
            figures=figures,
            renderer=backend.renderer(),
        )
    return {"out": str(folder.path), **figures, "seconds": round(time.perf_counter() - started, 3)}


def parsed(camera: str) -> Pinhole:
    """Read a camera written as `fx fy cx cy width height`.

    Raises:
        InputError: if it is not.
    """
    try:
        fx, fy, cx, cy, width, height = np.array(camera.split(), float).tolist()
    except ValueError as error:
        rule, example = "must be fx fy cx cy width height", "As '525 525 319.5 239.5 640 480'."
        raise errors.refuse("camera", rule, repr(camera), example) from error
    size = {"width": int(width), "height": int(height)}
    return Pinhole(**size, fx_px=fx, fy_px=fy, cx_px=cx, cy_px=cy)


def _opened(paths: Sequence[Path], layout: Layout, camera: Pinhole | None) -> dict[str, Stream]:
    """Streams by the names of their folders."""
    read = {"tum": tum.read, "labelfusion": labelfusion.read}[layout]
    found: dict[str, Stream] = {}
    for path in paths:
        name = path.resolve().name
        if name in found:
            raise errors.refuse("streams", "must have names of their own", name, "Rename one.")
        found[name] = read(path, camera)
    cameras = {one.camera for one in found.values()}
    if len(cameras) != 1:
        told, advice = f"{len(cameras)} cameras", "Give streams; those of others go apart."
        raise errors.refuse("streams", "must be of one camera", told, advice)
    return found


def _one(
    name: str,
    stream: Stream,
    info: CaptureInfo,
    fusion: Fusion,
    folder: Folder,
    track: progress.Progress,
) -> dict[str, Any]:
    frames = trajectory.posed(stream, fusion.every)
    mesh = fused(frames, stream.camera, fusion, track=track)
    folder.write_by(f"{name}.ply", lambda path: mesh.export(path, file_type="ply"))
    figures = pairs.write(name, frames, mesh, info, folder, track=track)
    return {
        "frames": len(frames),
        "without_pose": len(stream.moments[:: fusion.every]) - len(frames),
        "points": len(mesh.vertices),
        "triangles": len(mesh.faces),
        **figures,
    }
