"""Frames of reference of a ROS recording: /tf_static and /tf."""

from __future__ import annotations

import bisect
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from starling.sim.captures.recordings import messages
from starling.sim.captures.recordings.logs.message_log import LoggedMessage, LostMessageError
from starling.sim.geometry import frames
from starling.sim.geometry.frames import Pose

_LONGEST = 50  # Links of a chain; a longer one is a loop.
_NEAR_S = 0.05  # A moving frame is known within this time [s].


@dataclass(frozen=True, slots=True, eq=False)
class FrameTree:
    """Each frame's parent, with `parent_from_child` at one or more times."""

    fixed: dict[str, tuple[str, Pose]] = field(default_factory=dict)
    moving: dict[str, tuple[str, list[float], list[Pose]]] = field(default_factory=dict)

    def root_from(self, name: str, time_s: float) -> tuple[str, Pose, bool] | None:
        """Return the root above a frame, `root_from_frame`, and whether a link moves.

        None if a moving link is unknown at that time.
        """
        pose, moves = np.eye(4), False
        for _ in range(_LONGEST):
            if name in self.fixed:
                name, link = self.fixed[name]
            elif name in self.moving:
                name, times_s, poses = self.moving[name]
                place = bisect.bisect_left(times_s, time_s)
                around = range(max(place - 1, 0), min(place + 1, len(times_s)))
                nearest = min(around, key=lambda number: abs(times_s[number] - time_s))
                if abs(times_s[nearest] - time_s) > _NEAR_S:
                    return None
                link, moves = poses[nearest], True
            else:
                return name, pose, moves
            pose = link @ pose
        return None

    def between(self, first: str, second: str) -> Pose | None:
        """Return the fixed `second_from_first`; None if they are not connected by fixed links."""
        roots = []
        for name in (first, second):
            root = FrameTree(fixed=self.fixed).root_from(name, 0.0)
            if root is None:
                return None
            roots.append(root)
        if roots[0][0] != roots[1][0]:
            return None
        return np.linalg.inv(roots[1][1]) @ roots[0][1]


def read(
    fixed: Sequence[LoggedMessage], moving: Sequence[LoggedMessage], *, is_ros1: bool
) -> FrameTree:
    """Read the transforms of a recording; damaged messages are left out.

    Args:
        fixed: messages of /tf_static.
        moving: messages of /tf.
        is_ros1: how they are serialised.
    """
    tree = FrameTree()
    for entry in fixed:
        for _, parent, child, pose in _transforms(entry, is_ros1=is_ros1):
            tree.fixed[child] = (parent, pose)
    rows = [row for entry in moving for row in _transforms(entry, is_ros1=is_ros1)]
    for time_s, parent, child, pose in sorted(rows, key=lambda row: row[0]):
        _, times_s, poses = tree.moving.setdefault(child, (parent, [], []))
        times_s.append(time_s)
        poses.append(pose)
    return tree


def _transforms(entry: LoggedMessage, *, is_ros1: bool) -> list[tuple[float, str, str, Pose]]:
    """Return time, parent, child and `parent_from_child` of a message's transforms."""
    try:
        message = messages.parse(entry, is_ros1=is_ros1)
    except LostMessageError:
        return []
    rows = []
    for item in message.transforms:
        place, turn = item.transform.translation, item.transform.rotation
        quaternion = np.array([turn.x, turn.y, turn.z, turn.w])
        if not np.isfinite(quaternion).all() or not np.linalg.norm(quaternion):
            continue
        pose = frames.from_quaternion(np.array([place.x, place.y, place.z]), quaternion)
        stamp = item.header.stamp
        time_s = stamp.sec + stamp.nanosec / 1e9
        rows.append((time_s, item.header.frame_id.lstrip("/"), item.child_frame_id, pose))
    return rows
