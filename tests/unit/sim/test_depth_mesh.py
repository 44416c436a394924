"""Triangulation of a depth image: filled, smoothed, continued behind edges, and rendered."""

import numpy as np
import pytest

from starling.sim.render import direct, mitsuba_scene
from starling.sim.scene.captured import depth_surface, room_light
from starling.sim.scene.scene import Ambient, Body, Material, Scene
from starling.sim.sensor import presets
from starling.sim.stereo.depth import disparity_from_depth

SENSOR = presets.load("d435")
K = np.array([[SENSOR.fx_px, 0, SENSOR.cx_px], [0, SENSOR.fy_px, SENSOR.cy_px], [0, 0, 1]])


def step() -> np.ndarray:
    """Disparity of a near block in front of a far wall."""
    disparity = np.full((SENSOR.height, SENSOR.width), 10.0, np.float32)
    disparity[100:300, 300:500] = 30.0
    return disparity


def test_holes_are_closed_from_behind():
    disparity = step()
    disparity[150:250, 498:503] = np.nan
    closed = depth_surface.close_holes(disparity)
    assert np.isfinite(closed).all()
    assert (closed[155:245, 498:503] == 10.0).all()


def test_wide_holes_stay_open():
    disparity = step()
    disparity[:, 600:700] = np.nan
    closed = depth_surface.close_holes(disparity)
    assert np.isnan(closed[:, 650]).all()


def test_smoothing_removes_noise_but_keeps_edges():
    noisy = step() + np.random.default_rng(0).normal(0, 0.2, step().shape).astype(np.float32)
    smooth = depth_surface.smooth(noisy)
    assert np.std(smooth[320:460, 20:800]) < 0.3 * 0.2
    assert np.abs(smooth[100:300, 300] - 30).max() < 1.0
    assert np.abs(smooth[100:300, 299] - 10).max() < 1.0


def test_the_far_surface_continues_behind_the_near_one():
    hidden, source = depth_surface.continue_behind(step())
    assert (hidden[200, 300:340] == 10.0).all()  # Behind the block's left part.
    assert np.isnan(hidden[200, 400])  # Not behind its middle.
    assert np.isnan(hidden[200, 100])  # Not next to it.
    assert step().ravel()[source[200, 310]] == 10.0


def test_the_rendered_mesh_matches_its_depth_image():
    """Depth agrees within the triangles' error, without cracks, and the texture is in place."""
    rows, columns = np.mgrid[0 : SENSOR.height, 0 : SENSOR.width].astype(np.float32)
    disparity = 20 + 0.01 * columns + 2 * np.sin(rows / 40)
    texture = (0.2 + 0.6 * ((columns // 40 + rows // 40) % 2)).astype(np.float32)
    mesh = depth_surface.triangulate(disparity, K, SENSOR.focal_baseline_px_m)
    body = Body(name="b", mesh=mesh, material=Material(name="m"), texture=texture)
    even = Ambient(gradient=0.0)
    scene = Scene(name="s", bodies=(body,), ambient=even)
    layers = direct.layers(mitsuba_scene.MitsubaScene(scene), SENSOR)
    inner = (slice(2, -2), slice(2, -2))
    assert np.isfinite(layers.truth.depth_m[inner]).all()
    found = disparity_from_depth(
        layers.truth.depth_m, focal_px=SENSOR.fx_px, baseline_m=SENSOR.baseline_m
    )
    assert np.abs(found - disparity)[inner].max() < 0.01
    middle = layers.left.ambient[20::40, 20::40]
    expected = texture[20::40, 20::40]
    assert np.corrcoef(middle.ravel(), expected.ravel())[0, 1] > 0.98


def test_edges_are_cut_and_the_right_imager_sees_behind_them():
    disparity = step()
    near = depth_surface.triangulate(disparity, K, SENSOR.focal_baseline_px_m)
    hidden, _ = depth_surface.continue_behind(disparity)
    far = depth_surface.triangulate(hidden, K, SENSOR.focal_baseline_px_m, jump_px=8.0)
    grey = Material(name="m")
    bodies = (
        Body(name="near", mesh=near, material=grey),
        Body(name="far", mesh=far, material=grey),
    )
    layers = direct.layers(mitsuba_scene.MitsubaScene(Scene(name="s", bodies=bodies)), SENSOR)
    # The right imager sees behind the block's edge, where there must be no hole.
    assert (layers.right.ambient[200, 450:520] > 0).all()
    assert not layers.truth.right_sees[200, 282:298].any()


def test_round_spots_are_removed_and_stripes_stay():
    rows, columns = np.mgrid[0:120, 0:160].astype(np.float32)
    stripes = 30 + 10 * np.sin(columns / 2)
    spots = np.zeros_like(stripes)
    for v in range(10, 110, 9):
        for u in range(10, 150, 9):
            spots += 12 * np.exp(-((rows - v) ** 2 + (columns - u) ** 2) / (2 * 1.55**2))
    assert np.std(room_light.remove_dots(30 + spots)[12:-12, 12:-12]) < 0.2 * np.std(spots)
    remaining = room_light.remove_dots(stripes)
    assert np.corrcoef(remaining.ravel(), stripes.ravel())[0, 1] == pytest.approx(1.0, abs=0.02)


def test_a_slanted_plane_becomes_its_own_triangles() -> None:
    """Vertices lie on the plane, with matching uv and normals towards the camera."""
    intrinsics = np.array([[100.0, 0, 4.3], [0, 110.0, 3.1], [0, 0, 1]])
    row, column = np.mgrid[0:7, 0:9].astype(np.float32)
    disparity_px = (20 + 0.2 * column - 0.2 * row).astype(np.float32)
    mesh = depth_surface.triangulate(disparity_px, intrinsics, 10.0)
    x, y, z = mesh.vertices.T.astype(float)
    column, row = 100 * x / z + 4.3, 110 * y / z + 3.1
    np.testing.assert_allclose(10.0 / z, 20 + 0.2 * column - 0.2 * row, rtol=1e-5)
    assert mesh.uv is not None and mesh.normals is not None
    expected = np.stack([(column + 0.5) / 9, (row + 0.5) / 7], axis=1)
    np.testing.assert_allclose(mesh.uv, expected, atol=1e-5)
    normal = -np.array([100 * 0.2, 110 * -0.2, 20 + 0.2 * 4.3 - 0.2 * 3.1])
    normal /= np.linalg.norm(normal)
    np.testing.assert_allclose(mesh.normals, np.tile(normal, (63, 1)), atol=2e-3)
    a, b, c = (mesh.vertices[mesh.faces[:, corner]] for corner in range(3))
    assert ((np.cross(b - a, c - a) * normal).sum(axis=1) > 0).all()
