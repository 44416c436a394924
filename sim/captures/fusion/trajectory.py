"""Which moments of a stream are fused: those with a pose that can be."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from starling.patterns import errors
from starling.sim.captures.exchange.stream import Moment, Stream
from starling.sim.geometry.frames import Pose

_FARTHEST_M = 1000.0
_JUMP_M = 1.0  # At any time: views of one scene need not be a film.
_FASTEST_M_S = 10.0


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Posed:
    """A moment and where it was."""

    number: int  # In the stream.
    moment: Moment
    world_from_camera: Pose


def posed(stream: Stream, every: int = 1) -> list[Posed]:
    """Moments that have a pose, each `every`-th moment of the stream.

    Args:
        stream: in order of time.
        every: 1 takes all.

    Raises:
        InputError: if none has a pose, or a pose is not finite, no rigid one, more than 1 km from
            the origin, or farther from the one before than 1 m and 10 m/s allow.
    """
    errors.in_interval("every", every, 1, 10**6)
    found = [
        Posed(number=number, moment=moment, world_from_camera=moment.world_from_camera)
        for number, moment in list(enumerate(stream.moments))[::every]
        if moment.world_from_camera is not None
    ]
    if not found:
        advice = "Add its trajectory, with times as the images have them."
        raise errors.refuse("stream", "must have poses", f"{len(stream.moments)} frames", advice)
    for before, one in zip([found[0], *found], found, strict=False):
        _refuse_impossible(one)
        _refuse_jump(before, one)
    return found


def _refuse_impossible(one: Posed) -> None:
    pose = np.asarray(one.world_from_camera)
    turn = pose[:3, :3]
    rigid = np.isfinite(pose).all() and np.allclose(turn @ turn.T, np.eye(3), atol=1e-3)
    if not rigid or np.linalg.det(turn) < 0 or np.abs(pose[:3, 3]).max() > _FARTHEST_M:
        rule = f"must be rigid, within {_FARTHEST_M:g} m"
        raise errors.refuse(_name(one), rule, pose[:3].tolist(), "Give metres and quaternions.")


def _refuse_jump(before: Posed, one: Posed) -> None:
    far = np.linalg.norm(one.world_from_camera[:3, 3] - before.world_from_camera[:3, 3])
    since_s = one.moment.time_s - before.moment.time_s
    if far > _JUMP_M + _FASTEST_M_S * since_s:
        rule = f"must be within {_JUMP_M:g} m + {_FASTEST_M_S:g} m/s of the one before"
        advice = "Has tracking been lost? Cut the stream there; poses are in metres."
        raise errors.refuse(_name(one), rule, f"{far:.3g} m in {since_s:.3g} s", advice)


def _name(one: Posed) -> str:
    return f"pose at {one.moment.time_s:.6f} s"
