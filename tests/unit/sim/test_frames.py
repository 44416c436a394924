"""Poses and the conversion to Mitsuba's axes."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from starling.patterns import InputError
from starling.sim.geometry import frames

angles = st.tuples(*[st.floats(-170, 170)] * 3)


@given(angles)
def test_rotation_is_a_rotation_and_agrees_with_opencv(vector_deg):
    import cv2

    matrix = frames.rotation(vector_deg)
    np.testing.assert_allclose(matrix @ matrix.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(matrix) == pytest.approx(1.0)
    expected, _ = cv2.Rodrigues(np.deg2rad(np.asarray(vector_deg, np.float64)))
    np.testing.assert_allclose(matrix, expected, atol=1e-9)


@given(angles, st.tuples(*[st.floats(-5, 5)] * 3))
def test_mitsubas_axes_and_back(rotation_deg, position_m):
    pose = frames.pose(position_m, rotation_deg)
    np.testing.assert_allclose(
        frames.opencv_from_mitsuba(frames.mitsuba_to_world(pose)), pose, atol=1e-12
    )


@given(angles, st.tuples(*[st.floats(-5, 5)] * 3), st.tuples(*[st.floats(-5, 5)] * 3))
def test_poses_of_opengl_and_ros_keep_every_point(rotation_deg, position_m, point):
    """A point keeps its place in the world; only its name in the camera's frame changes."""
    right, down, forward = point
    pose = frames.pose(position_m, rotation_deg)
    for convert, named in (
        (frames.from_opengl, (right, -down, -forward)),
        (frames.from_ros, (forward, -right, -down)),
    ):
        np.testing.assert_allclose(
            convert(pose.tolist()) @ [*point, 1], pose @ [*named, 1], atol=1e-12
        )
    twice = frames.from_opengl(frames.from_opengl(pose))
    np.testing.assert_array_equal(twice, pose)


def test_poses_in_single_precision_are_taken():
    pose = frames.pose((1, 2, 3), (10, 20, 30)).astype(np.float32)
    assert frames.from_ros(pose).dtype == frames.from_opengl(pose).dtype == np.float64


@pytest.mark.parametrize(
    ("convert", "axes"), [(frames.from_opengl, "y up"), (frames.from_ros, "y left")]
)
def test_poses_that_are_not_rigid_are_refused(convert, axes):
    transposed = frames.pose((1, 2, 3), (0, 0, 0)).T
    for pose, words in (
        (np.eye(3), r"pose must be \(4, 4\); got \(3, 3\)"),
        ("pose", "pose must be an array"),
        (2 * np.eye(4), "pose must be rigid"),
        (np.full((4, 4), np.nan), "pose must be rigid"),
        (np.diag([1, 1, -1, 1]), f"pose must turn, not mirror.*{axes}"),
        (transposed, "last row of pose must be 0 0 0 1"),
    ):
        with pytest.raises(InputError, match=words):
            convert(pose)


def test_look_at_looks_at_its_target_with_up_up():
    pose = frames.look_at((1.0, 2.0, 3.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    target = np.linalg.inv(pose) @ np.array([1.0, 0.0, 0.0, 1.0])
    assert target[:2] == pytest.approx([0, 0], abs=1e-12)
    assert target[2] > 0
    above = np.linalg.inv(pose) @ np.array([1.0, 1.0, 0.0, 1.0])
    assert above[1] < 0  # y points down in the image.
    assert np.linalg.det(pose[:3, :3]) == pytest.approx(1.0)


def test_look_at_refuses():
    with pytest.raises(InputError, match="eye must differ from target"):
        frames.look_at((1.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    with pytest.raises(InputError, match="up must not be parallel"):
        frames.look_at((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 1.0, 0.0))


def test_centred_principal_point_has_no_offset():
    assert frames.principal_point_offset(319.5, 239.5, 640, 480) == pytest.approx((0.0, 0.0))
