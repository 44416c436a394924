"""Selection of the moments to fuse."""

from __future__ import annotations

import numpy as np
import pytest

from starling.patterns.errors import InputError
from starling.sim.captures.exchange.stream import Moment, Stream, posed_frames
from starling.sim.geometry import frames
from starling.sim.geometry.frames import Pose
from tests.unit.sim.fusion.bodies import CAMERA


def stream(*poses: Pose | None, step_s: float = 0.1) -> Stream:
    return Stream(
        camera=CAMERA,
        moments=tuple(
            Moment(
                time_s=number * step_s,
                world_from_camera=pose,
                depth=lambda: np.zeros((90, 120), np.float32),
                image=None,
            )
            for number, pose in enumerate(poses)
        ),
    )


def pose_at(x_m: float) -> Pose:
    return frames.pose((x_m, 0, 0))


def test_moments_without_a_pose_are_left_out():
    result = posed_frames(stream(None, pose_at(0), None, pose_at(0.1), pose_at(0.2)))
    assert [frame.number for frame in result] == [1, 3, 4]
    result = posed_frames(stream(pose_at(0), None, None, pose_at(0.1), pose_at(0.2)), every=2)
    assert [frame.number for frame in result] == [0, 4]


def test_jumps_are_limited_by_time():
    """Two seconds without a pose allow 21 m, a tenth of a second allows 2 m."""
    assert len(posed_frames(stream(pose_at(0), *[None] * 19, pose_at(20.9)))) == 2
    assert len(posed_frames(stream(pose_at(0), pose_at(1.9)))) == 2
    with pytest.raises(InputError, match=r"pose at 0\.100000 s must be within 1 m \+ 10 m/s"):
        posed_frames(stream(pose_at(0), pose_at(2.1)))


@pytest.mark.parametrize(
    "pose",
    [
        np.diag([1.0, 1.0, -1.0, 1.0]),  # Mirrors.
        np.diag([2.0, 2.0, 2.0, 1.0]),
        np.full((4, 4), np.nan),
        pose_at(2000.0),  # Millimetres.
    ],
)
def test_invalid_poses_are_refused(pose: Pose):
    with pytest.raises(InputError, match=r"pose at 0\.000000 s must be rigid, within 1000 m"):
        posed_frames(stream(pose))


def test_a_stream_without_poses_is_refused():
    with pytest.raises(InputError, match="stream must have poses; got 2 frames"):
        posed_frames(stream(None, None))
    with pytest.raises(InputError, match="every must be in"):
        posed_frames(stream(pose_at(0)), every=0)
