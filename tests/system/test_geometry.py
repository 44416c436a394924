"""Geometry of images: dots at known pixels, d = f b / z, occlusion and shadow masks."""

import dataclasses

import cv2
import numpy as np
import pytest

from starling.sim import metrics
from starling.sim.geometry import frames
from starling.sim.render import direct, mitsuba_scene, plugin_scene
from starling.sim.scene.builtin import scenes, solids
from starling.sim.scene.scene import Ambient, Material, Scene
from starling.sim.sensor import presets
from starling.sim.stereo.depth import depth_from_disparity, disparity_from_depth

RADIUS_M = 0.03  # Radius of the test balls, large enough for the pixel sampling [m].
WHITE = Material(name="white", reflectance=0.9)


def small(**changes):
    base = dataclasses.replace(
        presets.load("d435"),
        width=160,
        height=120,
        fx_px=100.0,
        fy_px=110.0,
        cx_px=70.3,
        cy_px=50.8,
    )
    return dataclasses.replace(base, **changes)


def spot_scene(point_m):
    ball = solids.sphere(RADIUS_M)
    ball.apply_translation(point_m)
    even = Ambient(gradient=0.0)  # Shading would move the centroid.
    spot = solids.body("spot", ball, WHITE)
    return mitsuba_scene.MitsubaScene(Scene(name="spot", bodies=(spot,), ambient=even))


def centroid(image):
    rows, columns = np.indices(image.shape)
    return (image * columns).sum() / image.sum(), (image * rows).sum() / image.sum()


@pytest.mark.parametrize("point_m", [(0.0, 0.0, 1.0), (0.21, -0.13, 1.1), (-0.3, 0.2, 0.9)])
def test_a_ball_is_seen_where_it_projects(point_m):
    sensor = small()
    layers = direct.layers(spot_scene(point_m), sensor, subpixels=16)
    x, y, z = point_m
    for view, offset in ((layers.left, 0.0), (layers.right, sensor.baseline_m)):
        u, v = centroid(view.ambient)
        nearer = z - RADIUS_M**2 / z  # The centroid of the outline is not the image of the centre.
        assert u == pytest.approx(sensor.fx_px * (x - offset) / nearer + sensor.cx_px, abs=0.03)
        assert v == pytest.approx(sensor.fy_px * y / nearer + sensor.cy_px, abs=0.03)


def test_a_rotated_camera_agrees_with_opencv():
    world_from_left = frames.look_at((0.3, -0.4, -0.2), (0.0, 0.0, 1.0), (0.0, -1.0, 0.0))
    point = np.array([0.1, 0.05, 1.2])
    sensor = small()
    scene = dataclasses.replace(spot_scene(point).scene, world_from_left=world_from_left)
    seen = centroid(
        direct.layers(mitsuba_scene.MitsubaScene(scene), sensor, subpixels=16).left.ambient
    )
    left_from_world = np.linalg.inv(world_from_left)
    vector, _ = cv2.Rodrigues(left_from_world[:3, :3])
    camera = np.array([[sensor.fx_px, 0, sensor.cx_px], [0, sensor.fy_px, sensor.cy_px], [0, 0, 1]])
    expected, _ = cv2.projectPoints(point[None], vector, left_from_world[:3, 3], camera, None)
    assert seen == pytest.approx(expected.ravel(), abs=0.03)


def test_mitsubas_camera_sees_the_same_pixel():
    """Axes, principal point and half-pixel shift of the conversion to Mitsuba."""
    from starling.sim.render import backend

    mi = backend.mitsuba()
    sensor = small(fy_px=100.0)  # Mitsuba's pixels are square.
    mi_scene = spot_scene((0.21, -0.13, 1.1))
    camera = plugin_scene.camera(sensor, np.eye(4), sampler=plugin_scene.fixed(16))
    integrator = mi.load_dict({"type": "aov", "aovs": "a:albedo"})
    image = np.array(mi.render(mi_scene.mitsuba, sensor=camera, integrator=integrator, spp=256))
    u, v = centroid(image[..., 0])
    assert u == pytest.approx(sensor.fx_px * 0.21 / 1.1 + sensor.cx_px, abs=0.03)
    assert v == pytest.approx(sensor.fy_px * -0.13 / 1.1 + sensor.cy_px, abs=0.03)


def test_a_projected_dot_lands_where_its_pixel_points(tmp_path):
    """A single dot from an offset projector on a wall, computed by hand."""
    image = np.zeros((120, 200), np.uint8)
    image[40:43, 150:153] = 255  # Centre at column 151, row 41.
    cv2.imwrite(str(tmp_path / "dot.png"), image)
    sensor = small()
    part = dataclasses.replace(
        sensor.projector,
        pattern=str(tmp_path / "dot.png"),
        position_m=(0.03, 0.01, 0.0),
        fov_x_deg=70.0,
        fov_y_deg=45.0,
    )
    sensor = dataclasses.replace(sensor, projector=part)
    seen = direct.layers(mitsuba_scene.MitsubaScene(scenes.wall(1.5)), sensor, subpixels=16)
    half_x, half_y = np.tan(np.deg2rad(35.0)), np.tan(np.deg2rad(22.5))
    x = (2 * (151 + 0.5) / 200 - 1) * half_x * 1.5 + 0.03
    y = (2 * (41 + 0.5) / 120 - 1) * half_y * 1.5 + 0.01
    u, v = centroid(seen.left.projector_direct)
    assert u == pytest.approx(sensor.fx_px * x / 1.5 + sensor.cx_px, abs=0.03)
    assert v == pytest.approx(sensor.fy_px * y / 1.5 + sensor.cy_px, abs=0.03)


@pytest.mark.parametrize("distance_m", [0.5, 1.0, 2.0, 4.0])
def test_disparity_of_a_wall_is_fb_over_z(distance_m):
    """Correlating the two noise-free renders finds f b / z within 0.02 px."""
    sensor = presets.load("d435")
    layers = direct.layers(mitsuba_scene.MitsubaScene(scenes.wall(distance_m)), sensor)
    expected = sensor.focal_baseline_px_m / distance_m
    views = tuple(v.projector_direct + v.ambient for v in (layers.left, layers.right))
    measured = metrics.shift_px(*views, near_px=expected, margin_px=int(expected) + 40)
    assert measured == pytest.approx(expected, abs=0.02)


def test_a_tilted_wall_has_affine_disparity():
    sensor = presets.load("d435")
    sheet = solids.body("wall", solids.plane(30, 30), WHITE, frames.pose((0, 0, 1.5), (13, 21, 3)))
    truth = direct.layers(
        mitsuba_scene.MitsubaScene(Scene(name="w", bodies=(sheet,))), sensor
    ).truth
    disparity = disparity_from_depth(
        truth.depth_m, focal_px=sensor.fx_px, baseline_m=sensor.baseline_m
    ).astype(np.float64)
    rows, columns = np.indices(disparity.shape)
    basis = np.stack([rows.ravel(), columns.ravel(), np.ones(rows.size)], axis=1)
    plane, *_ = np.linalg.lstsq(basis, disparity.ravel(), rcond=None)
    assert np.abs(basis @ plane - disparity.ravel()).max() < 1e-3
    back = depth_from_disparity(disparity, focal_px=sensor.fx_px, baseline_m=sensor.baseline_m)
    np.testing.assert_allclose(back, truth.depth_m, rtol=1e-5)


def test_masks_of_a_box_in_front_of_a_wall():
    """Occlusion and shadow next to a box are (b/z_box - b/z_wall) f pixels wide."""
    sensor = presets.load("d435")
    box = solids.body("box", solids.plane(0.3, 0.3), WHITE, frames.pose((0, 0, 1.0)))
    wall = solids.body("wall", solids.plane(20, 20), WHITE, frames.pose((0, 0, 2.0)))
    layers = direct.layers(
        mitsuba_scene.MitsubaScene(Scene(name="box", bodies=(box, wall))), sensor
    )
    truth, row = layers.truth, round(sensor.cy_px)
    inner = slice(100, -100)  # Outside the overlap and the projector's field.
    hidden = int((~truth.right_sees[row, inner]).sum())
    dark = int((~truth.lit[row, inner]).sum())
    assert hidden == pytest.approx(sensor.fx_px * sensor.baseline_m * 0.5, abs=1.01)
    assert dark == pytest.approx(sensor.fx_px * sensor.projector.position_m[0] * 0.5, abs=1.01)
    assert set(np.unique(truth.material)) == {1, 2}
    np.testing.assert_allclose(truth.normal[row, 400], (0, 0, -1), atol=1e-5)


def test_left_border_is_outside_the_right_image():
    sensor = presets.load("d435")
    truth = direct.layers(mitsuba_scene.MitsubaScene(scenes.wall(1.0)), sensor).truth
    border = int((~truth.right_sees[200]).sum())
    assert border == pytest.approx(sensor.focal_baseline_px_m, abs=1.01)
    assert not truth.right_sees[200, :border].any()


def test_renders_are_bit_identical():
    sensor = small()
    first, second = (
        direct.layers(mitsuba_scene.MitsubaScene(scenes.tabletop()), sensor) for _ in range(2)
    )
    for name in ("projector_direct", "ambient"):
        assert np.array_equal(getattr(first.left, name), getattr(second.left, name))
