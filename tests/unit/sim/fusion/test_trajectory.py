"""Which moments are fused."""

from __future__ import annotations

import numpy as np
import pytest

from starling.patterns.errors import InputError
from starling.sim.captures.exchange.stream import Moment, Stream
from starling.sim.captures.fusion import trajectory
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


def at(x_m: float) -> Pose:
    return frames.pose((x_m, 0, 0))


def test_moments_without_a_pose_are_left_out():
    found = trajectory.posed(stream(None, at(0), None, at(0.1), at(0.2)))
    assert [one.number for one in found] == [1, 3, 4]
    found = trajectory.posed(stream(at(0), None, None, at(0.1), at(0.2)), every=2)
    assert [one.number for one in found] == [0, 4]


def test_a_fast_camera_is_one_that_time_allows():
    """Two seconds without a pose let it go 21 m, a tenth of a second 2 m."""
    assert len(trajectory.posed(stream(at(0), *[None] * 19, at(20.9)))) == 2
    assert len(trajectory.posed(stream(at(0), at(1.9)))) == 2
    with pytest.raises(InputError, match=r"pose at 0\.100000 s must be within 1 m \+ 10 m/s"):
        trajectory.posed(stream(at(0), at(2.1)))


@pytest.mark.parametrize(
    "pose",
    [
        np.diag([1.0, 1.0, -1.0, 1.0]),  # Mirrors.
        np.diag([2.0, 2.0, 2.0, 1.0]),
        np.full((4, 4), np.nan),
        at(2000.0),  # Millimetres.
    ],
)
def test_what_is_no_pose_is_refused(pose: Pose):
    with pytest.raises(InputError, match=r"pose at 0\.000000 s must be rigid, within 1000 m"):
        trajectory.posed(stream(pose))


def test_a_stream_without_poses_is_refused():
    with pytest.raises(InputError, match="stream must have poses; got 2 frames"):
        trajectory.posed(stream(None, None))
    with pytest.raises(InputError, match="every must be in"):
        trajectory.posed(stream(at(0)), every=0)
