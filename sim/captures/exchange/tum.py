"""The layout of the TUM RGB-D benchmark: time-stamped images and depth, and a trajectory.

    rgb.txt, depth.txt      TIME FILE
    groundtruth.txt         TIME tx ty tz qx qy qz qw: camera in the world
    rgb/TIME.png, depth/TIME.png        depth in steps of 1/5000 m, 0 = none

Source: Sturm et al., A benchmark for the evaluation of RGB-D SLAM systems, IROS 2012, and its
page on file formats.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from starling.patterns.errors import InputError, refuse
from starling.sim import files, quantities
from starling.sim.captures import png
from starling.sim.captures.capture import CapturedScene
from starling.sim.captures.exchange.stream import (
    Moment,
    Stream,
    in_time_order,
    nearest,
    parse_camera,
    pose_of_left,
    poses_by_time,
    read_depth,
    refuse_equal_times,
)
from starling.sim.console.output import Folder, is_inside
from starling.sim.geometry import frames
from starling.sim.geometry.pinhole import Pinhole

UNIT_M = 1 / 5000
_CAMERA = "camera.txt"  # fx fy cx cy width height; TUM's own sets have none.


def export(scenes: Sequence[CapturedScene], folder: Folder) -> int:
    """Write scenes in order of time; the left infrared image takes the place of the colour image.

    Args:
        scenes: the poses are those in `frame.json`, or else `scene.toml`.
        folder: output folder.

    Returns:
        Number of written frames.

    Raises:
        InputError: if cameras differ, or a frame has no depth.
    """
    info = scenes[0].info
    lists: dict[str, list[str]] = {"rgb": [], "depth": [], "groundtruth": []}
    ordered = in_time_order(scenes)
    for timed in ordered:
        frame, code = timed.read(UNIT_M)
        time = f"{timed.time_s:.6f}"
        folder.write(f"depth/{time}.png", png.encode(code))
        lists["depth"].append(f"{time} depth/{time}.png")
        if frame.ir_left is not None:
            folder.write(f"rgb/{time}.png", png.encode(frame.ir_left))
            lists["rgb"].append(f"{time} rgb/{time}.png")
        pose = pose_of_left(timed.scene, frame.record)
        if pose is not None:
            numbers = (*pose[:3, 3], *frames.to_quaternion(pose))
            lists["groundtruth"].append(" ".join([time, *(f"{part:.9g}" for part in numbers)]))
    heads = {"rgb": "timestamp filename", "depth": "timestamp filename"}
    for name, lines in lists.items():
        head = heads.get(name, "timestamp tx ty tz qx qy qz qw")
        folder.write(f"{name}.txt", "\n".join([f"# {head}", *lines]) + "\n")
    camera = (info.fx_px, info.fy_px, info.cx_px, info.cy_px, info.width, info.height)
    folder.write(_CAMERA, " ".join(map(repr, camera)) + "\n")
    return len(ordered)


def read(path: Path, camera: Pinhole | None = None) -> Stream:
    """Open a sequence; images are read on demand.

    Args:
        path: folder of the sequence.
        camera: intrinsics of the depth images; None reads `camera.txt`, which `export` writes.

    Raises:
        InputError: if a list is missing or damaged, or the camera is unknown.
    """
    depths = _files(path / "depth.txt")
    if not depths:
        raise refuse("depth.txt", "must list depth images", path, "Is the sequence whole?")
    pictures = sorted(_files(path / "rgb.txt")) if (path / "rgb.txt").is_file() else []
    trajectory = path / "groundtruth.txt"
    poses = poses_by_time(_lines(trajectory), trajectory)
    moments = []
    for time, file in sorted(depths):
        picture = nearest(pictures, time)
        moments.append(
            Moment(
                time_s=time,
                world_from_camera=nearest(poses, time),
                depth=partial(read_depth, path / file, UNIT_M),
                image=None if picture is None else partial(png.read_picture, path / picture, "rgb"),
            )
        )
    without = sum(moment.image is None for moment in moments)
    if pictures and without:
        message = f"{path}: {without} of {len(moments)} depth images have no picture at their time."
        warnings.warn(message, stacklevel=2)
    return Stream(camera=camera or _camera(path), moments=tuple(moments))


def _files(path: Path) -> list[tuple[float, str]]:
    """Read a list of files at different times; names must stay in the sequence's folder."""
    listed = []
    for line, words in _lines(path):
        time = _number(words[0])
        if len(words) != 2 or time is None or not is_inside(words[1]):
            rule = "must have lines of a time and a file in the folder"
            value = f"{' '.join(words)[:80]!r} in line {line}"
            raise refuse(path.name, rule, value, "Is it TUM's layout?")
        quantities.check(f"time in line {line} of {path.name}", time, "time_s")
        listed.append((time, words[1]))
    refuse_equal_times((time for time, _ in listed), path.name)
    return listed


def _lines(path: Path) -> list[tuple[int, list[str]]]:
    """Split the lines of a list that are no comments; return them with their numbers."""
    lines = enumerate(files.read_text(path).splitlines(), 1)
    return [(number, line.split()) for number, line in lines if line.split("#", 1)[0].strip()]


def _number(word: str) -> float | None:
    try:
        return float(word)
    except ValueError:
        return None


def _camera(path: Path) -> Pinhole:
    advice = "Give the camera; TUM's own sets have no such file."
    try:
        return parse_camera(files.read_text(path / _CAMERA), _CAMERA)
    except InputError as error:
        raise InputError(f"{error} {advice}") from error
