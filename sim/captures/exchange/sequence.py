"""Frames of a capture set as the sequence of one camera."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from starling.patterns.errors import refuse
from starling.sim.captures.capture import CapturedScene, Frame
from starling.sim.geometry.frames import Pose
from starling.sim.geometry.pinhole import Pinhole

_STEP_S = 1 / 30  # Interval of frames without time stamps [s].


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class TimedFrame:
    """One frame and its time; images are read on demand."""

    time_s: float
    scene: CapturedScene
    number: int

    def read(self) -> tuple[Frame, NDArray[np.float32]]:
        """Read the frame and its depth (h, w) [m].

        Raises:
            InputError: as `CapturedScene.frame`, or if it has no depth.
        """
        frame = self.scene.frame(self.number)
        if frame.depth_m is None:
            name = f"frame {self.number} of {self.scene.name}"
            raise refuse(name, "must have depth", "none", "The layout needs depth.")
        return frame, frame.depth_m


def in_time_order(scenes: Sequence[CapturedScene]) -> list[TimedFrame]:
    """Return all frames in order of time.

    The times are the `timestamp` [s] of `frame.json`, if all frames have distinct ones. Otherwise
    the scenes follow each other at 30 frames per second, from 0.

    Raises:
        InputError: if the scenes are not of one camera.
    """
    first = scenes[0].info
    for scene in scenes:
        same = Pinhole.from_camera(scene.info) == Pinhole.from_camera(first)
        if not (same and scene.info.baseline_m == first.baseline_m):
            advice = "Export the scenes of one camera."
            raise refuse("scenes", "must be of one camera", scene.path, advice)
    frames = [(scene, number) for scene in scenes for number in scene.frames]
    stamps: list[Any] = [scene.record(number).get("timestamp") for scene, number in frames]
    times = [float(stamp) for stamp in stamps if isinstance(stamp, (int, float))]
    if len(set(times)) < len(frames):
        times = [count * _STEP_S for count in range(len(frames))]
    ordered = sorted(zip(times, range(len(frames)), strict=True))
    return [
        TimedFrame(time_s=time, scene=frames[index][0], number=frames[index][1])
        for time, index in ordered
    ]


def world_from_left(frame: Frame) -> Pose | None:
    """Return the left imager's pose in `frame.json`, or None without one."""
    pose = frame.record.get("left_from_world")
    return None if pose is None else np.linalg.inv(np.array(pose, float))
