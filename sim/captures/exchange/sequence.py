"""Scenes of a capture set as what one camera has seen, one frame after the other."""

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

_STEP_S = 1 / 30  # Between frames that tell no time.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Taken:
    """One frame and when it was taken; its images are read when asked for."""

    time_s: float
    scene: CapturedScene
    number: int

    def read(self) -> tuple[Frame, NDArray[np.float32]]:
        """Read it, and its depth (h, w) [m], which it must have.

        Raises:
            InputError: as `CapturedScene.frame`, or if it has no depth.
        """
        frame = self.scene.frame(self.number)
        if frame.depth_m is None:
            name = f"frame {self.number} of {self.scene.name}"
            raise refuse(name, "must have depth", "none", "The layout is of depth.")
        return frame, frame.depth_m


def of(scenes: Sequence[CapturedScene]) -> list[Taken]:
    """Put frames in order of time.

    What `frame.json` tells (`timestamp` [s]) counts if all frames tell it and no two the same;
    else scenes follow each other at 30 frames a second, from 0.

    Raises:
        InputError: if the scenes are not of one camera.
    """
    first = scenes[0].info
    for scene in scenes:
        same = Pinhole.of(scene.info) == Pinhole.of(first)
        if not (same and scene.info.baseline_m == first.baseline_m):
            advice = "Export the scenes of one camera."
            raise refuse("scenes", "must be of one camera", scene.path, advice)
    frames = [(scene, number) for scene in scenes for number in scene.frames]
    told: list[Any] = [scene.record(number).get("timestamp") for scene, number in frames]
    times = [float(one) for one in told if isinstance(one, (int, float))]
    if len(set(times)) < len(frames):
        times = [count * _STEP_S for count in range(len(frames))]
    ordered = sorted(zip(times, range(len(frames)), strict=True))
    return [
        Taken(time_s=time, scene=frames[index][0], number=frames[index][1])
        for time, index in ordered
    ]


def world_from_left(frame: Frame) -> Pose | None:
    """Pose of the left imager as `frame.json` tells it, None where it does not."""
    told = frame.record.get("left_from_world")
    return None if told is None else np.linalg.inv(np.array(told, float))
