"""`starling fuse`: from RGB-D streams to a capture set with reference depth."""

from __future__ import annotations

import dataclasses
import time
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np

from starling.patterns import errors
from starling.sim.captures import writer
from starling.sim.captures.exchange import labelfusion, tum
from starling.sim.captures.exchange.stream import Posed, Stream, parse_camera, posed_frames
from starling.sim.captures.fusion import pairs, volume
from starling.sim.captures.fusion.volume import Fusion, fuse_frames
from starling.sim.captures.info import CaptureInfo
from starling.sim.console import names, progress
from starling.sim.console.output import Folder, OutputFolder, refuse_own_input
from starling.sim.geometry.pinhole import Pinhole
from starling.sim.render import backend
from starling.sim.sensor import presets, resolve

_NEAREST_M = 0.35  # Kinects measure from 0.4 m [m].
_LOOKED_AT = 5  # Frames whose depth is looked at before fusion.

Layout = Literal["tum", "labelfusion"]


def fuse(
    streams: Sequence[Path],
    out: Path,
    *,
    layout: Layout,
    camera: str = "",
    sensor: str = "kinect-v1",
    mode: str = "",
    fusion: Fusion | None = None,
    force: bool = False,
    track: progress.Progress = progress.silent,
) -> dict[str, Any]:
    """Fuse each stream to a surface, and pair each frame with the surface's depth.

    Args:
        streams: folders, each of one static room, all of one camera.
        out: folder of the capture set: one scene per frame, one room and NAME.ply per stream.
        layout: layout of the streams.
        camera: `fx fy cx cy width height` [px]; empty uses the streams' intrinsics.
        sensor: preset of the device, for its name and baseline.
        mode: mode of the device, of the streams' image size; empty is the preset's own.
        fusion: settings; None uses the defaults.
        force: replace an earlier folder.
        track: wraps loops over frames.

    Returns:
        `{"out", "frames", "without_pose", "points", "triangles", "voxel_m", "streams",
        "seconds"}`. `streams` holds the counts of each stream by name, and the figures of
        `starling.sim.captures.fusion.pairs`.

    Raises:
        InputError: if streams, poses, camera or the folder are invalid; no partial output remains.
    """
    started = time.perf_counter()
    fusion = fusion or Fusion()
    volume.refuse_without()
    opened = _opened(streams, layout, parse_camera(camera) if camera else None)
    for path in streams:
        refuse_own_input(out, path)
    device = presets.load(sensor, mode=mode)
    info = CaptureInfo(
        **dataclasses.asdict(next(iter(opened.values())).camera),
        sensor=device.name,
        baseline_m=device.baseline_m,
        depth_unit_m=pairs.UNIT_M,
        source=f"{layout}: {', '.join(opened)}",
        licence="as the streams'",
        notes="truth.png: the surface fused of all frames' depth.png, from where each was taken",
    )
    if mode:
        resolve.refuse_other_size(device, info)
    with OutputFolder(out, force=force) as folder:
        by_stream = {
            name: _fuse_stream(name, opened[name], info, fusion, folder, track) for name in opened
        }
        counted = ("frames", "without_pose", "points", "triangles")
        figures = {
            **{key: sum(stream[key] for stream in by_stream.values()) for key in counted},
            "voxel_m": fusion.voxel_m,
            "streams": by_stream,
        }
        arguments = {
            "streams": [str(path) for path in streams],
            **{"layout": layout, "camera": camera, "sensor": sensor, "mode": mode},
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


def _opened(paths: Sequence[Path], layout: Layout, camera: Pinhole | None) -> dict[str, Stream]:
    """Open the streams; return them by the names of their folders."""
    read = {"tum": tum.read, "labelfusion": labelfusion.read}[layout]
    opened: dict[str, Stream] = {}
    if not paths:
        raise errors.refuse("streams", "must be given", "nothing", "Name their folders.")
    for path in paths:
        name = names.scene_folder(path.resolve().name)
        if name in opened:
            raise errors.refuse("streams", "must have names of their own", name, "Rename one.")
        opened[name] = read(path, camera)
    cameras = {stream.camera for stream in opened.values()}
    if len(cameras) != 1:
        count, advice = f"{len(cameras)} cameras", "Fuse the streams of each camera separately."
        raise errors.refuse("streams", "must be of one camera", count, advice)
    return opened


def _warn_small(frames: Sequence[Posed], name: str) -> None:
    """Warn of depth nearer than any camera of these layouts measures: its unit is another one."""
    few = [frames[int(place)] for place in np.linspace(0, len(frames) - 1, _LOOKED_AT)]
    medians = [np.nanmedian(m) for m in (p.moment.depth() for p in few) if np.isfinite(m).any()]
    if medians and np.median(medians) < _NEAREST_M:
        warnings.warn(
            f"{name}: the median depth is {np.median(medians):.2g} m. Is depth in millimetres? "
            f"This layout has other steps.",
            stacklevel=2,
        )


def _fuse_stream(
    name: str,
    stream: Stream,
    info: CaptureInfo,
    fusion: Fusion,
    folder: Folder,
    track: progress.Progress,
) -> dict[str, Any]:
    frames = posed_frames(stream, fusion.every)
    _warn_small(frames, name)
    mesh = fuse_frames(frames, stream.camera, fusion, track=track)
    folder.write_by(f"{name}.ply", lambda path: mesh.export(path, file_type="ply"))
    figures = pairs.write(name, frames, mesh, info, folder, track=track)
    return {
        "frames": len(frames),
        "without_pose": len(stream.moments[:: fusion.every]) - len(frames),
        "points": len(mesh.vertices),
        "triangles": len(mesh.faces),
        **figures,
    }
