"""Surfaces fused from exact depth are exact; noise is averaged; free space is carved."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from starling.patterns.errors import InputError
from starling.sim.captures.fusion import blocks, volume
from starling.sim.captures.fusion.volume import Volume
from starling.sim.geometry import frames
from tests.unit.sim.fusion import bodies

VOXEL_M = 0.01


def off_plane(points: np.ndarray) -> np.ndarray:
    return points @ bodies.NORMAL - bodies.AWAY_M


def filled(depth_of, voxel_m: float = VOXEL_M) -> Volume:
    result = Volume(bodies.CAMERA, voxel_m)
    for pose in bodies.poses(5):
        result.add(depth_of(pose), pose)
    return result


@given(st.lists(st.integers(-(2**20), 2**20 - 1), min_size=3, max_size=3))
def test_keys_and_block_numbers_round_trip(block: list[int]):
    numbers = np.array([block], np.int64)
    np.testing.assert_array_equal(blocks.numbers(blocks.keys_of(numbers)), numbers)


def test_slanted_plane_has_its_true_position():
    """Distances to a plane are linear, so only float32 and the coarse band limit the accuracy."""
    mesh = volume.triangulate(filled(bodies.plane), least=2)
    error = off_plane(np.asarray(mesh.vertices))
    assert np.median(np.abs(error)) < 2e-3 * VOXEL_M
    assert np.percentile(np.abs(error), 95) < 0.05 * VOXEL_M
    assert np.abs(error).max() < VOXEL_M


def test_ball_has_its_true_position():
    """Checked on the side facing the cameras; near the outline pixels are wider than the band."""
    points = np.asarray(volume.triangulate(filled(bodies.ball), least=2).vertices)
    facing = points[points[:, 2] < bodies.MIDDLE_M[2] - 0.8 * bodies.RADIUS_M]
    error = np.linalg.norm(facing - bodies.MIDDLE_M, axis=1) - bodies.RADIUS_M
    assert len(facing) > 500 and np.median(np.abs(error)) < 0.02 * VOXEL_M
    assert np.percentile(np.abs(error), 95) < 0.05 * VOXEL_M


def test_fronts_face_the_camera():
    mesh = volume.triangulate(filled(bodies.plane))
    assert (mesh.face_normals @ bodies.NORMAL < -0.9).mean() > 0.999


def test_seams_between_tiles_are_closed():
    """A plane seen once has one outline: no edge of one triangle lies inside it."""
    mesh = volume.triangulate(filled(bodies.plane))
    edges, counts = np.unique(mesh.edges_sorted, axis=0, return_counts=True)
    assert counts.max() == 2
    border = np.asarray(mesh.vertices)[np.unique(edges[counts == 1])]
    pose = np.linalg.inv(bodies.poses(5)[2])
    seen = border @ pose[:3, :3].T + pose[:3, 3]
    u = bodies.CAMERA.fx_px * seen[:, 0] / seen[:, 2] + bodies.CAMERA.cx_px
    v = bodies.CAMERA.fy_px * seen[:, 1] / seen[:, 2] + bodies.CAMERA.cy_px
    inside = (np.abs(u - 60) < 40) & (np.abs(v - 45) < 25)
    assert not inside.any()


@pytest.mark.parametrize("count", [4, 16])
def test_noise_falls_with_the_root_of_the_number_of_frames(count: int):
    """It can fall faster, because a vertex mixes the noise of several pixels."""
    rng, sigma_m = np.random.default_rng(count), 2e-3
    noisy = Volume(bodies.CAMERA, 0.02)  # As wide as a pixel is there: little is mixed.
    pose = bodies.poses(1)[0]
    for _ in range(count):
        noise = rng.normal(0, sigma_m, bodies.plane(pose).shape)
        noisy.add((bodies.plane(pose) + noise).astype(np.float32), pose)
    error = off_plane(np.asarray(volume.triangulate(noisy).vertices))
    inner = error[np.abs(error) < 0.01]
    expected = sigma_m / np.sqrt(count)
    assert 0.3 * expected < inner.std() < 1.05 * expected
    assert abs(inner.mean()) < 0.1 * expected


def test_removed_objects_are_carved_away():
    """An object in one frame leaves no surface if nine other frames see the plane through it."""
    result = Volume(bodies.CAMERA, VOXEL_M)
    pose = bodies.poses(1)[0]
    passing = bodies.plane(pose).copy()
    passing[30:50, 40:70] = 0.6
    for depth_m in [passing, *[bodies.plane(pose)] * 9]:
        result.add(depth_m, pose)
    near = np.asarray(volume.triangulate(result).vertices)[:, 2] < 0.7
    assert not near.any()


def test_voxels_seen_too_rarely_are_no_surface():
    result = Volume(bodies.CAMERA, VOXEL_M)
    first, second = frames.pose((0, 0, 0)), frames.pose((0.6, 0, 0))
    for pose in (first, second):
        result.add(np.full((90, 120), 1.0, np.float32), pose)
    wide, narrow = (
        np.asarray(volume.triangulate(result, least=least).vertices) for least in (1, 2)
    )
    half = 60 / bodies.CAMERA.fx_px
    assert wide[:, 0].min() == pytest.approx(-half, abs=0.05)
    assert narrow[:, 0].min() == pytest.approx(0.6 - half, abs=0.05)


def test_holes_stay_holes():
    pose, depth_m = bodies.poses(1)[0], bodies.plane(bodies.poses(1)[0]).copy()
    depth_m[30:60, 40:80] = np.nan
    result = Volume(bodies.CAMERA, VOXEL_M)
    result.add(depth_m, pose)
    points = (
        np.asarray(volume.triangulate(result).vertices) @ pose[:3, :3]
    )  # At the origin, turned.
    points = points - pose[:3, 3] @ pose[:3, :3]
    u = bodies.CAMERA.fx_px * points[:, 0] / points[:, 2] + bodies.CAMERA.cx_px
    v = bodies.CAMERA.fy_px * points[:, 1] / points[:, 2] + bodies.CAMERA.cy_px
    assert len(points) and not ((u > 41) & (u < 78) & (v > 31) & (v < 58)).any()


def test_invalid_streams_are_refused(monkeypatch: pytest.MonkeyPatch):
    with pytest.raises(InputError, match="voxel must be in"):
        Volume(bodies.CAMERA, 5.0)
    with pytest.raises(InputError, match="band must be in"):
        Volume(bodies.CAMERA, 0.01, 0.01)
    nothing = Volume(bodies.CAMERA, 0.01)
    nothing.add(np.full((90, 120), np.nan, np.float32), np.eye(4))
    with pytest.raises(InputError, match="surface must be seen; got 0 blocks"):
        volume.triangulate(nothing)
    monkeypatch.setattr(volume, "_MOST", 10)
    with pytest.raises(InputError, match="volume must have at most 10 blocks"):
        filled(bodies.plane)
    monkeypatch.setitem(sys.modules, "skimage.measure", None)
    with pytest.raises(InputError, match="surface needs scikit-image"):
        volume.refuse_without()
