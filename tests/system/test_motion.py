"""Motion blur and rolling shutter of a moving sensor, compared with f v t / z.

Rationale: the sensor moves parallel to a plane at z with speed v. The plane's image moves by
f v t / z pixels in time t. The dots move with the sensor.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from starling.sim.geometry import frames
from starling.sim.render import direct, mitsuba_scene
from starling.sim.scene.builtin import scenes
from starling.sim.scene.scene import Ambient, Body, Material, Mesh, Motion, Scene
from starling.sim.sensor import presets

FOCAL_PX = 200.0
DISTANCE_M = 1.5
DARK, BRIGHT = 0.1, 0.9
EXPOSURE_S = 20e-3


def small(**changes):
    base = dataclasses.replace(
        presets.load("d435"),
        width=160,
        height=120,
        fx_px=FOCAL_PX,
        fy_px=FOCAL_PX,
        cx_px=79.5,
        cy_px=59.5,
    )
    return dataclasses.replace(base, **changes)


LEAN = 0.05  # Slope of edges against the columns, so that all pixel phases occur.


def edge(
    motion: Motion, *, at_m: float = 0.0, axis: int = 0, lean: float = LEAN
) -> mitsuba_scene.MitsubaScene:
    """A plane, dark up to `at_m` along x (axis 0) or y (axis 1) and bright beyond."""
    texture = np.full((8, 8), DARK, np.float32)
    texture[:, 4:] = BRIGHT
    # The edge is the blend of the middle two of eight texels, narrowed to 0.1 mm.
    span = np.array([-6.0, at_m - 5e-5, at_m + 5e-5, 6.0])
    across = np.array([0.0, 3.5, 4.5, 8.0]) / 8
    u, v = np.meshgrid(across, [0.0, 1.0])
    along, across_m = np.meshgrid(span, [-6.0, 6.0])
    along = along + lean * across_m
    points = np.stack([along, across_m, np.full_like(along, DISTANCE_M)], axis=-1).reshape(-1, 3)
    faces = [[i, i + 4, i + 1] for i in range(3)] + [[i + 1, i + 4, i + 5] for i in range(3)]
    mesh = Mesh(
        vertices=np.float32(points if axis == 0 else points[:, [1, 0, 2]]),
        faces=np.array(faces, np.uint32),
        uv=np.float32(np.stack([u, v], axis=-1).reshape(-1, 2)),
    )
    body = Body(name="edge", mesh=mesh, material=Material(name="grey"), texture=texture)
    light = Ambient(gradient=0.0)
    return mitsuba_scene.MitsubaScene(
        Scene(name="edge", bodies=(body,), ambient=light, motion=motion)
    )


def shares(image):
    """Level of each pixel, from 0 (dark) to 1 (bright)."""
    return (image.astype(np.float64) * np.pi - DARK) / (BRIGHT - DARK)


def smear_px(mi_scene: mitsuba_scene.MitsubaScene, sensor, axis: int = 0) -> float:
    """Length of motion blur at the edge, from the variance of the slope in each row or column.

    A box of width w has variance w^2 / 12. The pixel and the difference of neighbours add boxes of
    1 px.
    """
    layers = direct.layers(mi_scene, sensor, subpixels=4, exposure_s=EXPOSURE_S)
    image = shares(layers.left.ambient)
    slope = np.diff(image if axis == 0 else image.T, axis=1)
    place = np.arange(slope.shape[1])
    mean = (slope @ place) / slope.sum(axis=1)
    variance = (slope * (place - mean[:, None]) ** 2).sum(axis=1) / slope.sum(axis=1)
    return float(np.sqrt(12 * variance.mean() - 2))


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("speed_m_s", [0.75, 2.25, 7.5])
def test_sideways_motion_blurs_by_f_v_t_over_z(speed_m_s, axis):
    """To 3 %, from 2 to 20 px. The test excludes depth edges."""
    velocity = (speed_m_s, 0.0, 0.0) if axis == 0 else (0.0, speed_m_s, 0.0)
    mi_scene = edge(Motion(velocity_m_s=velocity), axis=axis)
    expected = FOCAL_PX * speed_m_s * EXPOSURE_S / DISTANCE_M
    assert smear_px(mi_scene, small(), axis) == pytest.approx(expected, rel=0.03)


def test_long_motion_blur_is_smooth():
    """The ramp of 20 px is linear, up to the step of one of its 40 time samples."""
    mi_scene = edge(Motion(velocity_m_s=(7.5, 0.0, 0.0)), lean=0.0)
    share = shares(direct.layers(mi_scene, small(), exposure_s=EXPOSURE_S).left.ambient)[0]
    inside = np.flatnonzero((share > 0.1) & (share < 0.9))
    line = np.polyval(np.polyfit(inside, share[inside], 1), inside)
    assert len(inside) == 16
    assert np.abs(share[inside] - line).max() < 1 / 40


@pytest.mark.parametrize("at_once", [pytest.param(1, marks=pytest.mark.long), 3])
def test_the_batch_size_of_time_samples_changes_no_bit(at_once, monkeypatch):
    """Views with and without rolling shutter, with all 40 time samples per launch or fewer."""
    shutter = dataclasses.replace(small().left, rolling_shutter_s=EXPOSURE_S)
    for speed_m_s, sensor in ((0.0, small()), (7.5, small(left=shutter))):
        mi_scene = edge(Motion(velocity_m_s=(speed_m_s, 0.0, 0.0)))
        whole = direct.layers(mi_scene, sensor, subpixels=2, exposure_s=EXPOSURE_S)
        with monkeypatch.context() as patched:
            patched.setattr(direct, "_RAYS", at_once * 160 * 120)
            parts = direct.layers(mi_scene, sensor, subpixels=2, exposure_s=EXPOSURE_S)
        for view, part in ((whole.left, parts.left), (whole.right, parts.right)):
            np.testing.assert_array_equal(view.ambient, part.ambient)
            np.testing.assert_array_equal(view.projector_direct, part.projector_direct)


def test_larger_time_steps_keep_the_blur_length():
    """Steps of 2 px instead of 0.5 px: 16 instead of 40 time samples for a ramp of 20 px."""
    mi_scene = edge(Motion(velocity_m_s=(7.5, 0.0, 0.0)), lean=0.0)
    fine, coarse = (
        shares(direct.layers(mi_scene, small(), exposure_s=EXPOSURE_S, step_px=px).left.ambient)[0]
        for px in (0.5, 2.0)
    )
    np.testing.assert_allclose(16 * coarse, np.round(16 * coarse), atol=1e-3)
    assert 0.02 < np.abs(fine - coarse).max() < 1 / 16 + 1 / 40


@pytest.mark.parametrize("smear", [2, -3])
@pytest.mark.parametrize("axis", [0, 1])
def test_forward_motion_blurs_along_the_radius(smear, axis):
    """The blur is f X (1 / z_end - 1 / z_start) at distance X from the axis, to 3 %."""
    speed = 6.0
    way = speed * EXPOSURE_S / 2
    at_m = smear / FOCAL_PX / (1 / (DISTANCE_M - way) - 1 / (DISTANCE_M + way))
    mi_scene = edge(Motion(velocity_m_s=(0.0, 0.0, speed)), at_m=at_m, axis=axis)
    assert smear_px(mi_scene, small(), axis) == pytest.approx(abs(smear), rel=0.03)


def test_forward_motion_leaves_the_middle_sharp():
    mi_scene = edge(Motion(velocity_m_s=(0.0, 0.0, 4.0)), lean=0.0)
    share = shares(direct.layers(mi_scene, small(), exposure_s=EXPOSURE_S).left.ambient)
    assert set(np.round(share, 3).ravel()) == {0.0, 1.0}


def test_a_rotation_blurs_by_f_w_t():
    """Rotation about y, in the middle of the image, at any distance."""
    rate = float(np.rad2deg(8 / FOCAL_PX / EXPOSURE_S))
    mi_scene = edge(Motion(turn_deg_s=(0.0, rate, 0.0)))
    assert smear_px(mi_scene, small()) == pytest.approx(8, rel=0.03)


def test_dots_on_a_plane_move_with_the_sensor():
    """Motion parallel to an even wall does not change the dots in either imager.

    The test excludes surfaces with relief, where the dots move.
    """
    wall = dataclasses.replace(scenes.wall(DISTANCE_M), motion=Motion(velocity_m_s=(2.0, 1.0, 0.0)))
    moving = direct.layers(mitsuba_scene.MitsubaScene(wall), small(), exposure_s=EXPOSURE_S)
    still = direct.layers(mitsuba_scene.MitsubaScene(scenes.wall(DISTANCE_M)), small())
    for name in ("left", "right"):
        a, b = (getattr(layers, name).projector_direct for layers in (moving, still))
        assert np.abs(a - b).max() < 1e-3 * b.max()


@pytest.mark.parametrize("side", ["left", "right"])
def test_rolling_shutter_leans_edges(side):
    """The edge leans by f v t / z over the image's height, t from first to last row, to 2 %."""
    speed, readout = 3.0, 15e-3
    mi_scene = edge(Motion(velocity_m_s=(speed, 0.0, 0.0)), lean=0.0)
    sensor = small()
    rolling = dataclasses.replace(
        sensor,
        left=dataclasses.replace(sensor.left, rolling_shutter_s=readout),
        right=dataclasses.replace(sensor.right, rolling_shutter_s=readout),
    )
    image = getattr(direct.layers(mi_scene, rolling), side).ambient
    # The bright share of a row gives the edge position.
    edges = sensor.width - shares(image).sum(axis=1) - 0.5
    rows = np.arange(sensor.height)
    lean, middle = np.polyfit(rows - rows.mean(), edges, 1)
    # The sensor moves right, so the edge moves left.
    expected = -FOCAL_PX * speed * readout / DISTANCE_M
    assert lean * (sensor.height - 1) == pytest.approx(expected, rel=0.02)
    offset = 0.0 if side == "left" else sensor.baseline_m
    place = sensor.cx_px - FOCAL_PX * offset / DISTANCE_M
    assert middle == pytest.approx(place, abs=0.05)  # The middle row is on time.


def test_the_truth_belongs_to_the_middle_of_the_exposure():
    mi_scene = edge(Motion(velocity_m_s=(1.0, 0.0, 3.0), turn_deg_s=(0.0, 30.0, 0.0)))
    still = mitsuba_scene.MitsubaScene(dataclasses.replace(mi_scene.scene, motion=Motion()))
    moving, resting = (direct.layers(s, small(), exposure_s=EXPOSURE_S) for s in (mi_scene, still))
    for name in ("depth_m", "normal", "right_sees", "lit"):
        assert np.array_equal(getattr(moving.truth, name), getattr(resting.truth, name))
    assert np.array_equal(moving.left.depth_m, resting.left.depth_m)


def test_without_motion_nothing_changes():
    """Without motion, exposure and rolling shutter change no bit."""
    sensor = small()
    rolling = dataclasses.replace(
        sensor, left=dataclasses.replace(sensor.left, rolling_shutter_s=0.02)
    )
    mi_scene = mitsuba_scene.MitsubaScene(scenes.tabletop())
    plain, rolled = (
        direct.layers(mi_scene, sensor),
        direct.layers(mi_scene, rolling, exposure_s=0.03),
    )
    for side in ("left", "right"):
        for name in ("projector_direct", "ambient", "other", "depth_m"):
            pair = (getattr(getattr(layers, side), name) for layers in (plain, rolled))
            assert np.array_equal(*pair, equal_nan=True)


def test_a_moving_rig_equals_a_static_rig_at_its_pose():
    """With a very short shutter, each row equals that of a static rig at the row's pose."""
    motion = Motion(velocity_m_s=(4.0, -2.0, 5.0), turn_deg_s=(60.0, -90.0, 200.0))
    sensor, readout = small(), 20e-3
    rolling = dataclasses.replace(
        sensor,
        left=dataclasses.replace(sensor.left, rolling_shutter_s=readout),
        right=dataclasses.replace(sensor.right, rolling_shutter_s=readout),
    )
    scene = dataclasses.replace(
        scenes.tabletop(), world_from_left=frames.pose((0.05, -0.1, 0.1), (5.0, 10.0, -8.0))
    )
    seen = direct.layers(
        mitsuba_scene.MitsubaScene(dataclasses.replace(scene, motion=motion)), rolling
    )
    for row in (0, 37, sensor.height - 1):
        time = (row / (sensor.height - 1) - 0.5) * readout
        position, turn = (
            tuple(value * time for value in rate)
            for rate in (motion.velocity_m_s, motion.turn_deg_s)
        )
        static = dataclasses.replace(
            scene, world_from_left=scene.world_from_left @ frames.pose(position, turn)
        )
        resting = direct.layers(mitsuba_scene.MitsubaScene(static), sensor)
        for side in ("left", "right"):
            for name in ("projector_direct", "ambient"):
                a, b = (getattr(getattr(x, side), name)[row] for x in (seen, resting))
                # Rounding moves some rays across an edge.
                assert np.quantile(np.abs(a - b), 0.97) < 1e-3 * b.max()
