"""Moments of a stream with a valid pose, which are fused."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from starling.patterns import errors
from starling.sim.captures.exchange.stream import Moment, Stream
from starling.sim.geometry.frames import Pose

_FARTHEST_M = 1000.0  # Largest distance of a pose from the origin [m].
_JUMP_M = 1.0  # Jump accepted at any time [m]: views need not form a continuous film.
_FASTEST_M_S = 10.0  # Largest speed beyond that jump [m/s].


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
    errors.in_interval("every", every, 1, 10**6)
    frames = [
        Posed(number=number, moment=moment, world_from_camera=moment.world_from_camera)
        for number, moment in list(enumerate(stream.moments))[::every]
        if moment.world_from_camera is not None
    ]
    if not frames:
        advice = "Add its trajectory, with the times of the images."
        raise errors.refuse("stream", "must have poses", f"{len(stream.moments)} frames", advice)
    for before, frame in zip([frames[0], *frames], frames, strict=False):
        _refuse_impossible(frame)
        _refuse_jump(before, frame)
    return frames


def _refuse_impossible(frame: Posed) -> None:
    pose = np.asarray(frame.world_from_camera)
    turn = pose[:3, :3]
    rigid = np.isfinite(pose).all() and np.allclose(turn @ turn.T, np.eye(3), atol=1e-3)
    if not rigid or np.linalg.det(turn) < 0 or np.abs(pose[:3, 3]).max() > _FARTHEST_M:
        rule = f"must be rigid, within {_FARTHEST_M:g} m"
        raise errors.refuse(_name(frame), rule, pose[:3].tolist(), "Give metres and quaternions.")


def _refuse_jump(before: Posed, frame: Posed) -> None:
    far = np.linalg.norm(frame.world_from_camera[:3, 3] - before.world_from_camera[:3, 3])
    since_s = frame.moment.time_s - before.moment.time_s
    if far > _JUMP_M + _FASTEST_M_S * since_s:
        rule = f"must be within {_JUMP_M:g} m + {_FASTEST_M_S:g} m/s of the previous pose"
        advice = "Cut the stream where tracking was lost; give poses in metres."
        raise errors.refuse(_name(frame), rule, f"{far:.3g} m in {since_s:.3g} s", advice)


def _name(frame: Posed) -> str:
    return f"pose at {frame.moment.time_s:.6f} s"
