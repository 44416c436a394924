"""Surfaces, their segmentation into objects, and the information of a shape on its pose."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from starling.learning.icp import cloud, objects
from starling.learning.icp.cloud import Cloud
from starling.patterns.errors import InputError
from starling.sim.captures import capture
from tests.unit.learning.drawn_scene import (
    BALL_CENTRE_M,
    BALL_RADIUS_M,
    INFO,
    ball_depth,
    box_depth,
    depth,
    rays,
)


def interior(mask: np.ndarray, away_px: int = 6) -> np.ndarray:
    """Pixels of a mask at least this far from its border."""
    return np.asarray(ndimage.distance_transform_edt(mask)) >= away_px


def test_normals_of_a_slanted_plane_are_its_own():
    """n . x = 1 for n = (0.3, -0.2, 0.8) / m; to 0.01 degrees, towards the imager."""
    n = np.array([0.3, -0.2, 0.8])
    z = (1 / (rays() @ n)).astype(np.float32)
    z[100:110, 200:210] = np.nan
    shown = cloud.surface(z, INFO)
    flat = shown.cloud(np.ones(INFO.shape, bool))
    assert len(flat) == INFO.width * INFO.height - 100
    np.testing.assert_allclose(flat.point_m @ n, 1, rtol=1e-5)
    np.testing.assert_allclose(flat.normal @ (-n / np.linalg.norm(n)), 1, atol=2e-8)
    assert np.isnan(shown.normal[105, 205]).all()


def test_normals_of_a_ball_point_away_from_its_centre():
    """Mean over the ball within 1 degree, because windows measure chords, not tangents."""
    on_ball = interior(ball_depth() < 5, 10)
    seen = cloud.surface(depth(), INFO).cloud(on_ball)
    outwards = (seen.point_m - BALL_CENTRE_M) / BALL_RADIUS_M
    cosine = (seen.normal * outwards).sum(axis=1)
    assert np.degrees(np.arccos(np.clip(cosine, -1, 1))).mean() < 1


def test_moved_cloud_turns_its_normals():
    item = Cloud(point_m=np.array([[1.0, 0, 0]]), normal=np.array([[0.0, 1, 0]]))
    motion = np.array([[0.0, -1, 0, 5], [1, 0, 0, 6], [0, 0, 1, 7], [0, 0, 0, 1]])
    np.testing.assert_allclose(item.moved(motion).rows(), [[5, 7, 7, -1, 0, 0]])


def grid(n: int = 21) -> tuple[np.ndarray, np.ndarray]:
    side = (np.arange(n) + 0.5) / n * 2 - 1
    a, b = np.meshgrid(side, side)
    return a.ravel(), b.ravel()


def cube() -> Cloud:
    a, b = grid(101)
    points, normals = [], []
    for axis in range(3):
        for sign in (-1, 1):
            face = np.insert(np.stack([a, b], axis=1), axis, sign, axis=1)
            points.append(face)
            normals.append(np.broadcast_to(sign * np.eye(3)[axis], face.shape))
    return Cloud(point_m=np.concatenate(points) * 0.3 + 7, normal=np.concatenate(normals))


def test_information_of_known_shapes():
    assert objects.information(cube()) == pytest.approx(2 / 15, rel=1e-3)
    a, b = grid()
    flat = np.stack([a, b, np.zeros_like(a)], axis=1)
    sheet = Cloud(point_m=flat, normal=np.tile([0.0, 0, 1], (len(a), 1)))
    assert objects.information(sheet) == pytest.approx(0, abs=1e-12)
    around = np.stack([np.cos(np.pi * a), np.sin(np.pi * a), np.zeros_like(a)], axis=1)
    tube = Cloud(point_m=around + b[:, None] * [0, 0, 1], normal=around)
    assert objects.information(tube) == pytest.approx(0, abs=1e-12)
    direction = np.random.default_rng(0).normal(size=(5000, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    ball = Cloud(point_m=direction, normal=direction)
    assert objects.information(ball) == pytest.approx(0, abs=1e-3)
    assert objects.information(Cloud(point_m=flat[:5], normal=flat[:5])) == 0


def test_a_scene_is_divided_at_steps_only():
    z = depth()
    label = objects.convex_pieces(cloud.surface(z, INFO), INFO.disparity_px(z), fewest_px=300)
    box, ball = box_depth() < 5, ball_depth() < 5
    wall = ~box & ~ball
    for mask in (box, ball, wall):
        inside, counts = np.unique(label[interior(mask, 9)], return_counts=True)
        assert counts.max() / counts.sum() > 0.99, (inside, counts)
        original = inside[counts.argmax()]
        assert original > 0
        assert (label[mask] == original).mean() > 0.97
        assert (label[~mask] == original).sum() < 0.02 * mask.sum()


def test_a_concave_crease_separates_surfaces():
    """A floor that meets a wall is two pieces, a roof's ridge is one."""
    y = rays()[..., 1]
    floor = np.where(y > 0, 0.25 / np.maximum(y, 1e-9), np.inf)
    room = np.minimum(floor, 1.0).astype(np.float32)
    roof = (1 / (1.2 - 1.5 * np.abs(rays()[..., 0]))).astype(np.float32)
    parts = []
    for z in (room, roof):
        shown = cloud.surface(z, INFO)
        label = objects.convex_pieces(shown, INFO.disparity_px(z), fewest_px=500)
        parts.append(np.unique(label).tolist())
    assert set(parts[0]) - {0} == {1, 2}
    assert set(parts[1]) - {0} == {1}


def test_objects_have_shapes_that_determine_their_pose():
    """The box, but not the ball (its rotation is unobservable) or the wall (too large, flat)."""
    (box,) = objects.in_room(depth(), INFO, scene="s", room="r")
    seen = box_depth() < 5
    assert (box.pixels & seen).sum() > 0.97 * seen.sum()
    assert not (box.pixels & ~seen).sum() > 0.02 * seen.sum()
    assert 0.24 < box.side_m < np.linalg.norm([0.24, 0.2, 0.16])
    assert box.observable
    assert (box.scene, box.room) == ("s", "r")
    np.testing.assert_allclose(box.centre_m, box.surface.point_m.mean(axis=0))


def test_small_objects_and_those_in_the_left_band_are_excluded():
    z = depth()
    small = np.where(box_depth() < 5, z, np.nan).astype(np.float32) * 0.2
    assert objects.in_room(small, INFO, scene="s", room="r") == []  # 3 cm.
    left = np.roll(z, -200, axis=1)
    for piece in objects.in_room(left, INFO, scene="s", room="r"):
        assert not piece.pixels[:, : objects.LEFT_BAND_PX].any()


def test_labelled_objects_are_used():
    label = np.where(box_depth() < 5, 4, np.where(ball_depth() < 5, 7, 0)).astype(np.uint8)
    (box,) = objects.by_label(depth(), label, INFO, scene="s", room="r")  # A ball has no pose.
    assert box.name == "4"
    assert (box.pixels == (label == 4)).all()


def test_labels_of_another_shape_are_refused():
    label = np.zeros(INFO.shape, np.uint8)
    with pytest.raises(InputError, match=r"label must be of shape \(360, 480\); got \(3, 3\)"):
        objects.by_label(depth(), label[:3, :3], INFO, scene="s", room="r")


def test_a_scanned_room_has_objects(captures):
    """In one room of the laser scanner, objects are separate and have observable poses.

    Whether a person would call them objects can be seen in a picture only.
    """
    room = capture.open_set(captures / "d415-faro" / "0060")
    (scene,) = room.scenes
    reference = scene.truth_m()
    assert reference is not None
    result = objects.in_room(reference, room.info, scene=scene.name, room=scene.room)
    assert len(result) >= 10
    assert np.sum([piece.pixels for piece in result], axis=0).max() == 1
    assert all(piece.observable and 0.1 <= piece.side_m <= 0.6 for piece in result)
