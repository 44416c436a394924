"""RGB-D streams of a moving camera, independent of the layout.

A `Stream` is read from files. The frames of a capture set in time order are written to them.
"""

from __future__ import annotations

import bisect
import itertools
import math
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from starling.patterns.errors import in_interval, refuse
from starling.sim import quantities
from starling.sim.captures import png
from starling.sim.captures.capture import CapturedScene, Frame
from starling.sim.geometry import frames
from starling.sim.geometry.frames import Pose
from starling.sim.geometry.pinhole import Pinhole
from starling.sim.stereo.depth import from_code, to_code

NEAR_S = 0.02  # Times within this difference count as equal [s].
_DIGITS = 6  # Decimals of a time [s] in file names.
_LARGEST_CODE = 2**16 - 1  # Of depth in 16 bits.
_STEP_S = 1 / 30  # Interval of frames without time stamps [s].
_FARTHEST_M = 1000.0  # Largest distance of a pose from the origin [m].
_ROUNDING = 0.01  # Deviation of a quaternion's length from 1 that is accepted.
_JUMP_M = 1.0  # Jump accepted at any time [m]: views need not form a continuous film.
_FASTEST_M_S = 10.0  # Largest speed beyond that jump [m/s].

_T = TypeVar("_T")


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Moment:
    """Image, depth and pose at one time."""

    time_s: float
    world_from_camera: Pose | None  # OpenCV frame; None without a pose within `NEAR_S`.
    depth: Callable[[], NDArray[np.float32]]  # Reads z [m] (h, w), NaN = none.
    image: Callable[[], NDArray[Any]] | None  # Reads (h, w, 3) or (h, w), 8 or 16 bits.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Stream:
    """Moments of one camera, in order of time."""

    camera: Pinhole
    moments: tuple[Moment, ...]


def nearest(timed: Sequence[tuple[float, _T]], time_s: float) -> _T | None:
    """Return the item nearest in time, or None if none is within `NEAR_S`; `timed` is sorted."""
    index = bisect.bisect_left(timed, time_s, key=lambda pair: pair[0])
    around = timed[max(index - 1, 0) : index + 1]
    if not around:
        return None
    nearest_s, item = min(around, key=lambda pair: abs(pair[0] - time_s))
    return item if abs(nearest_s - time_s) <= NEAR_S else None


def poses_by_time(rows: Iterable[tuple[int, list[str]]], path: Path) -> list[tuple[float, Pose]]:
    """Convert rows `TIME tx ty tz qx qy qz qw` to poses, in order of time.

    A row with a pose that is not finite is left out with a warning: tracking was lost there.

    Args:
        rows: number and words of each line.
        path: file, for messages.

    Raises:
        InputError: if a row has other content, an implausible time, or a quaternion whose length is
            not 1. Also if two poses have one time.
    """
    poses: list[tuple[float, Pose]] = []
    lost = 0
    for line, words in rows:
        try:
            numbers = np.array(words, np.float64)
        except ValueError:
            numbers = np.zeros(0)
        if len(numbers) != 8:
            rule = "must have lines TIME tx ty tz qx qy qz qw"
            raise refuse(
                path.name, rule, f"{' '.join(words)[:80]!r} in line {line}", "Is it whole?"
            )
        quantities.check(f"time in line {line} of {path.name}", float(numbers[0]), "time_s")
        if not np.isfinite(numbers).all():
            lost += 1
        elif abs(math.hypot(*numbers[4:]) - 1) > _ROUNDING:
            rule, value = "must have quaternions of length 1", " ".join(words[4:])[:80]
            raise refuse(path.name, rule, f"{value} in line {line}", "Is it a trajectory?")
        else:
            poses.append((float(numbers[0]), frames.from_quaternion(numbers[1:4], numbers[4:])))
    if lost:
        warnings.warn(f"{path}: {lost} poses are not finite; these frames have none.", stacklevel=2)
    poses.sort(key=lambda timed: timed[0])
    for (before_s, before), (time_s, pose) in itertools.pairwise(poses):
        if time_s == before_s and not np.array_equal(pose, before):
            rule, advice = "must have one pose at a time", "Is it one trajectory?"
            raise refuse(path.name, rule, f"two at {time_s:.6f} s", advice)
    return poses


def refuse_equal_times(times_s: Iterable[float], name: str) -> None:
    """Refuse two images of one time.

    Raises:
        InputError: if two times are equal.
    """
    for before_s, time_s in itertools.pairwise(sorted(times_s)):
        if time_s == before_s:
            rule, advice = "must have one file at a time", "Is it one sequence?"
            raise refuse(name, rule, f"two at {time_s:.6f} s", advice)


def parse_camera(text: str, name: str = "camera") -> Pinhole:
    """Parse intrinsics written as `fx fy cx cy width height`.

    Args:
        text: six numbers.
        name: name of the text in error messages.

    Raises:
        InputError: if the text has another form, or the camera is implausible.
    """
    try:
        fx, fy, cx, cy, width, height = map(float, text.split())
        size = {"width": int(width), "height": int(height)}
        if (width, height) != (size["width"], size["height"]):
            raise ValueError("width and height are whole numbers")
    except (ValueError, OverflowError) as error:
        rule, example = "must be fx fy cx cy width height", "As '525 525 319.5 239.5 640 480'."
        raise refuse(name, rule, repr(text[:80]), example) from error
    return Pinhole(**size, fx_px=fx, fy_px=fy, cx_px=cx, cy_px=cy)


def read_depth(path: Path, unit_m: float) -> NDArray[np.float32]:
    """Read depth z [m] (h, w), NaN = none, from 16-bit codes.

    Raises:
        InputError: if the file cannot be read, or has 8 bits.
    """
    code = png.read(path, "depth")
    if code.dtype != np.uint16:
        raise refuse("depth", "must be of 16 bits", f"{path}, 8-bit", "Extract it again.")
    return from_code(code.astype(np.uint16), unit_m)


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class TimedFrame:
    """One frame and its time; images are read on demand."""

    time_s: float
    scene: CapturedScene
    number: int

    def read(self, unit_m: float) -> tuple[Frame, NDArray[np.uint16]]:
        """Read the frame and its depth (h, w) in steps of `unit_m`, 0 = none.

        Depth beyond the largest code becomes none, with a warning.

        Raises:
            InputError: as `CapturedScene.frame`, or if it has no depth.
        """
        frame = self.scene.frame(self.number)
        if frame.depth_m is None:
            name = f"frame {self.number} of {self.scene.name}"
            raise refuse(name, "must have depth", "none", "The layout needs depth.")
        code = to_code(frame.depth_m, unit_m)
        if (np.isfinite(frame.depth_m) & (code == 0)).any():
            farthest_m = _LARGEST_CODE * unit_m
            message = f"depth beyond {farthest_m:.4g} m is exported as missing."
            warnings.warn(message, stacklevel=2)  # The text is constant, so it is printed once.
        return frame, code


def by_room(scenes: Sequence[CapturedScene]) -> dict[str, list[CapturedScene]]:
    """Return the scenes of each room, in their order."""
    rooms: dict[str, list[CapturedScene]] = {}
    for scene in scenes:
        rooms.setdefault(scene.room, []).append(scene)
    return rooms


def in_time_order(scenes: Sequence[CapturedScene]) -> list[TimedFrame]:
    """Return all frames in order of time.

    The times are the `timestamp` [s] of `frame.json`, if all frames have distinct ones. Otherwise
    the scenes follow each other at 30 frames per second, from 0, with a warning if any frame has a
    time stamp. Poses of several rooms in one trajectory give another warning.

    Raises:
        InputError: if the scenes are not of one camera.
    """
    first = scenes[0].info
    for scene in scenes:
        same = Pinhole.from_camera(scene.info) == Pinhole.from_camera(first)
        if not (same and scene.info.baseline_m == first.baseline_m):
            advice = "Export the scenes of one camera."
            raise refuse("scenes", "must be of one camera", scene.path, advice)
    numbered = [(scene, number) for scene in scenes for number in scene.frames]
    stamps = [scene.record(number).get("timestamp") for scene, number in numbered]
    times = [float(stamp) for stamp in stamps if stamp is not None]
    if len({round(time, _DIGITS) for time in times}) < len(numbered):
        if times:
            place = f"{scenes[0].path.parent}, {len(numbered)} frames"
            message = f"{place}: time stamps are missing or equal; none is used."
            warnings.warn(message, stacklevel=2)
        times = [count * _STEP_S for count in range(len(numbered))]
    _warn_of_rooms(scenes)
    ordered = sorted(zip(times, range(len(numbered)), strict=True))
    return [
        TimedFrame(time_s=time, scene=numbered[index][0], number=numbered[index][1])
        for time, index in ordered
    ]


def _warn_of_rooms(scenes: Sequence[CapturedScene]) -> None:
    """Warn of poses in several rooms, whose origins usually differ."""
    posed = {s.room for s in scenes if left_from_world(s, s.record(s.frames[0])) is not None}
    if len(posed) > 1:
        message = f"poses of {len(posed)} rooms form one trajectory; is their origin the same?"
        warnings.warn(f"{scenes[0].path.parent}: {message}", stacklevel=2)


def left_from_world(scene: CapturedScene, record: Mapping[str, Any]) -> Pose | None:
    """Return the transform (4, 4) from the world to the left imager; None if it is unknown.

    Args:
        scene: the frame's scene; the pose in its `scene.toml` applies to frames without their own.
        record: the frame's `frame.json`.

    Raises:
        InputError: as `CapturedScene.known`.
    """
    if "left_from_world" in record:
        return np.array(record["left_from_world"], np.float64)
    known = scene.known()
    return None if known is None else np.array(known.left_from_world, np.float64)


def pose_of_left(scene: CapturedScene, record: Mapping[str, Any]) -> Pose | None:
    """Return the left imager's pose in the world, the inverse of `left_from_world`."""
    transform = left_from_world(scene, record)
    return None if transform is None else np.asarray(np.linalg.inv(transform), np.float64)


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Posed:
    """A moment with its pose."""

    number: int  # Index in the stream.
    moment: Moment
    world_from_camera: Pose


def posed_frames(stream: Stream, every: int = 1) -> list[Posed]:
    """Return the moments with a pose, out of each `every`-th moment of the stream.

    Args:
        stream: stream in order of time.
        every: step between moments; 1 uses all.

    Raises:
        InputError: if no moment has a pose, or a pose is not finite, not rigid or more than 1 km
            from the origin. Also if it is farther from the previous one than 1 m + 10 m/s allow.
    """
    in_interval("every", every, 1, 10**6)
    posed = [
        Posed(number=number, moment=moment, world_from_camera=moment.world_from_camera)
        for number, moment in list(enumerate(stream.moments))[::every]
        if moment.world_from_camera is not None
    ]
    if not posed:
        advice = "Add its trajectory, with the times of the images."
        raise refuse("stream", "must have poses", f"{len(stream.moments)} frames", advice)
    for before, frame in zip([posed[0], *posed], posed, strict=False):
        _refuse_impossible(frame)
        _refuse_jump(before, frame)
    return posed


def _refuse_impossible(frame: Posed) -> None:
    pose = np.asarray(frame.world_from_camera)
    turn = pose[:3, :3]
    rigid = np.isfinite(pose).all() and np.allclose(turn @ turn.T, np.eye(3), atol=1e-3)
    if not rigid or np.linalg.det(turn) < 0 or np.abs(pose[:3, 3]).max() > _FARTHEST_M:
        rule = f"must be rigid, within {_FARTHEST_M:g} m"
        raise refuse(_name(frame), rule, pose[:3].tolist(), "Give metres and quaternions.")


def _refuse_jump(before: Posed, frame: Posed) -> None:
    far = np.linalg.norm(frame.world_from_camera[:3, 3] - before.world_from_camera[:3, 3])
    since_s = frame.moment.time_s - before.moment.time_s
    if far > _JUMP_M + _FASTEST_M_S * since_s:
        rule = f"must be within {_JUMP_M:g} m + {_FASTEST_M_S:g} m/s of the previous pose"
        advice = "Cut the stream where tracking was lost; give poses in metres."
        raise refuse(_name(frame), rule, f"{far:.3g} m in {since_s:.3g} s", advice)


def _name(frame: Posed) -> str:
    return f"pose at {frame.moment.time_s:.6f} s"
