"""Alignment of a disturbed object: conventions of OpenCV's ICP, and pose errors."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from starling.learning.icp import cloud, objects, study
from starling.learning.icp.study import Disturbance
from starling.patterns.errors import InputError
from starling.sim.geometry.frames import rotation
from tests.unit.learning.drawn_scene import INFO, depth

CENTRE = np.array([0.1, -0.2, 0.9])


@pytest.fixture(scope="module")
def box() -> objects.Piece:
    (piece,) = objects.in_room(depth(), INFO, scene="s", room="r")
    return piece


@pytest.mark.parametrize("turn_deg", [(4, -3, 5), (-6, 2, 0)])
def test_a_known_motion_is_recovered(box, turn_deg):
    """To 1 mm and 0.3 degrees; `found` moves the model to the scene, its inverse does not."""
    draw = np.random.default_rng(0)
    reference = cloud.surface(depth(), INFO)
    scene = reference.cloud(study.scene_pixels(box, reference, draw))
    motion = np.eye(4)
    motion[:3, :3] = rotation(turn_deg)
    motion[:3, 3] = box.centre_m - motion[:3, :3] @ box.centre_m + [0.01, -0.008, 0.012]
    result = study.register(study.model_points(box, draw).moved(motion), scene)
    right = study.pose_error(result @ motion, box.centre_m)
    assert right.position_m < 1e-3
    assert right.rotation < 1 - np.cos(np.radians(0.3) / 2)
    wrong = study.pose_error(np.linalg.inv(result) @ motion, box.centre_m)
    assert wrong.position_m > 0.015


def test_scene_points_are_near_the_object_at_the_same_pixels(box):
    reference = cloud.surface(depth(), INFO)
    chosen = study.scene_pixels(box, reference, np.random.default_rng(1))
    np.testing.assert_array_equal(
        chosen, study.scene_pixels(box, reference, np.random.default_rng(1))
    )
    away = np.linalg.norm(reference.point_m[chosen] - box.centre_m, axis=1)
    reach = np.linalg.norm(box.surface.point_m - box.centre_m, axis=1).max()
    assert away.max() <= reach + study.MARGIN_M + 1e-6
    assert chosen.sum() == pytest.approx(study.SCENE_POINTS, rel=0.1)


def test_model_points_are_in_random_order(box):
    model = study.model_points(box, np.random.default_rng(2))
    assert len(model) == study.MODEL_POINTS
    height = model.point_m[:, 1]
    half = len(height) // 2
    assert abs(height[:half].mean() - height[half:].mean()) < 0.2 * height.std()
    known = {tuple(point) for point in box.surface.point_m}
    assert all(tuple(point) in known for point in model.point_m)


@given(degrees=st.floats(0, 180), shift=st.floats(0, 0.5), seed=st.integers(0, 1000))
def test_pose_error_of_angle_and_centre(degrees, shift, seed):
    axis, way = np.random.default_rng(seed).normal(size=(2, 3))
    turned = np.eye(4)
    turned[:3, :3] = rotation(tuple(degrees * axis / np.linalg.norm(axis)))
    turned[:3, 3] = CENTRE - turned[:3, :3] @ CENTRE + shift * way / np.linalg.norm(way)
    error = study.pose_error(turned, CENTRE)
    assert error.position_m == pytest.approx(shift, abs=1e-9)
    assert error.rotation == pytest.approx(1 - np.cos(np.radians(degrees) / 2), abs=1e-7)


def test_disturbances_are_uniform_up_to_their_limits():
    """Lengths and angles are uniform with a mean of half the limit (1000 draws: 5 %); isotropic."""
    limits, draw = Disturbance(most_m=0.04, most_deg=20), np.random.default_rng(3)
    moved = [limits.draw(CENTRE, draw) for _ in range(1000)]
    errors = [study.pose_error(motion, CENTRE) for motion in moved]
    length = np.array([error.position_m for error in errors])
    angle = 2 * np.degrees(np.arccos(1 - np.array([error.rotation for error in errors])))
    for value, most in ((length, 0.04), (angle, 20)):
        assert value.max() <= most * (1 + 1e-6)
        assert value.mean() == pytest.approx(most / 2, rel=0.05)
    shift = np.stack([motion[:3, :3] @ CENTRE + motion[:3, 3] - CENTRE for motion in moved])
    assert np.abs(shift.mean(axis=0)).max() < 0.04 * 0.05


def test_no_disturbance_is_no_motion():
    still = Disturbance(most_m=0, most_deg=0).draw(CENTRE, np.random.default_rng(0))
    np.testing.assert_allclose(still, np.eye(4), atol=1e-15)


def test_invalid_disturbances_are_refused():
    with pytest.raises(InputError, match=r"most_m must be in \[0, 1\]; got -0\.1"):
        Disturbance(most_m=-0.1)
    with pytest.raises(InputError, match=r"most_deg must be in \[0, 180\]; got 181"):
        Disturbance(most_deg=181)


def test_normals_rotate_with_their_cloud():
    motion = np.eye(4)
    motion[:3, :3], motion[:3, 3] = [[0, -1, 0], [1, 0, 0], [0, 0, 1]], (1, 2, 3)
    along = np.array([[1.0, 0.0, 0.0]])
    moved = cloud.Cloud(point_m=along, normal=along).moved(motion)
    np.testing.assert_allclose(moved.point_m, [[1, 3, 3]])
    np.testing.assert_allclose(moved.normal, [[0, 1, 0]])
