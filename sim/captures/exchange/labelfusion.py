"""Import of LabelFusion logs: numbered images and depth, their times, and a trajectory.

    images/0000000001_rgb.png, 0000000001_depth.png     depth 16 bits, millimetres, 0 = none
    images/0000000001_utime.txt                         microseconds
    posegraph.posegraph         TIME tx ty tz qx qy qz qw: camera in its first frame, seconds
    posegraph_smoothed.posegraph                        the same, smoothed; preferred if present
    camera.cfg                                          fx fy cx cy [px], as ElasticFusion reads it

Both images of a number come from one message, so `utime` is also the time of the depth. The
trajectory's seconds times 1e6 equal `utime`. Its poses have z forward and y down.

Source: Marion et al., Label Fusion: a pipeline for generating ground truth labels for real RGBD
data of cluttered scenes, ICRA 2018. In its program at commit e4d90be, `imagecapture.py` and
`utils.py` define names, numbers and types of images. `rendertrainingimages.py` defines unit and
order of the trajectory, and prefers the smoothed one. Depth is extracted there on request only.
Its intrinsics are hard-coded (528 528 320 240). `camera.cfg` is the argument of ElasticFusion's
flag -cal; a log may lack it.
"""

from __future__ import annotations

import re
from functools import partial
from pathlib import Path

from starling.patterns.errors import refuse
from starling.sim import files, quantities
from starling.sim.captures import png
from starling.sim.captures.exchange.stream import (
    Moment,
    Stream,
    nearest,
    poses_by_time,
    read_depth,
    refuse_equal_times,
)
from starling.sim.geometry.frames import Pose
from starling.sim.geometry.pinhole import Pinhole

UNIT_M = 1e-3
_TRAJECTORIES = ("posegraph_smoothed.posegraph", "posegraph.posegraph")
_LONGEST = 18  # Digits of a time in microseconds.
_CAMERA = "camera.cfg"
_DEPTH = re.compile(r"(\d{10})_depth\.png")


def read(path: Path, camera: Pinhole | None = None) -> Stream:
    """Open a log; images are read on demand.

    Args:
        path: folder of the log.
        camera: intrinsics of the depth images; None reads `camera.cfg`.

    Raises:
        InputError: if there is no depth, a time or the trajectory is missing or damaged, or the
            camera is unknown.
    """
    images = path / "images"
    numbers = sorted(match[1] for match in map(_DEPTH.fullmatch, _names(images)) if match)
    if not numbers:
        advice = "Extract them from the log: run_create_data -d."
        raise refuse("log", "must hold images/NUMBER_depth.png", path, advice)
    poses = _poses(path)
    moments = []
    for number in numbers:
        time_s = _time_s(images / f"{number}_utime.txt")
        picture = images / f"{number}_rgb.png"
        moments.append(
            Moment(
                time_s=time_s,
                world_from_camera=nearest(poses, time_s),
                depth=partial(read_depth, images / f"{number}_depth.png", UNIT_M),
                image=partial(png.read_picture, picture, "rgb", colour=True)
                if picture.is_file()
                else None,
            )
        )
    moments.sort(key=lambda moment: moment.time_s)
    refuse_equal_times((moment.time_s for moment in moments), images.name)
    first = images / f"{numbers[0]}_depth.png"
    return Stream(camera=camera or _camera(path / _CAMERA, first), moments=tuple(moments))


def _names(images: Path) -> list[str]:
    return [path.name for path in images.iterdir()] if images.is_dir() else []


def _time_s(path: Path) -> float:
    text = files.read_text(path).strip()
    if not text.isdecimal() or len(text) > _LONGEST:
        raise refuse(path.name, "must hold microseconds", repr(text[:40]), "Is the log whole?")
    quantities.check(f"time in {path.name}", int(text) / 1e6, "time_s")
    return int(text) / 1e6


def _poses(path: Path) -> list[tuple[float, Pose]]:
    trajectory = next((path / name for name in _TRAJECTORIES if (path / name).is_file()), None)
    if trajectory is None:
        raise refuse("log", f"must hold {_TRAJECTORIES[-1]}", path, "Run ElasticFusion on it.")
    lines = enumerate(files.read_text(trajectory).splitlines(), 1)
    return poses_by_time(((n, line.split()) for n, line in lines if line.strip()), trajectory)


def _camera(path: Path, depth: Path) -> Pinhole:
    advice = "Give the camera. LabelFusion's default is 528 528 320 240 at 640 x 480."
    rule = "must hold fx fy cx cy"
    if not path.is_file():
        raise refuse(_CAMERA, rule, "no file", advice)
    words = files.read_text(path).split()
    try:
        fx, fy, cx, cy = map(float, words)
    except ValueError as error:
        raise refuse(_CAMERA, rule, " ".join(words)[:80], advice) from error
    height, width = png.read(depth, "depth").shape
    return Pinhole(width=width, height=height, fx_px=fx, fy_px=fy, cx_px=cx, cy_px=cy)
