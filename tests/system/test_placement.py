"""Baseline error and model error, compared with transformed bodies and with f b / z.

Rationale: the program transforms the rig instead of the geometry. The test transforms the bodies.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from starling.sim.geometry import frames, placement
from starling.sim.render import direct, indirect, mitsuba_scene
from starling.sim.scene.builtin import scenes, solids
from starling.sim.scene.scene import Ambient, Material, Mesh, ModelError, Motion, Scene, Sun
from starling.sim.sensor import presets
from starling.sim.sensor.sensor import Projector
from starling.sim.stereo.depth import depth_from_disparity

SCALE = 1.04
SHIFT_M = (0.02, -0.03, 0.05)
TURN_DEG = (2.0, -3.0, 1.0)
LAYERS = ("projector_direct", "projector_indirect", "ambient", "other")


def small(**changes):
    base = dataclasses.replace(
        presets.load("d435"),
        width=160,
        height=120,
        fx_px=100.0,
        fy_px=100.0,
        cx_px=70.3,
        cy_px=50.8,
    )
    return dataclasses.replace(base, **changes)


def tabletop() -> Scene:
    """A table with sun and another projector, from an arbitrary view."""
    return dataclasses.replace(
        scenes.tabletop(),
        world_from_left=frames.pose((0.05, -0.1, 0.1), (10.0, 4.0, -6.0)),
        sun=Sun(irradiance_w_m2=0.4),
        other_projector=Projector(power_w=0.2, position_m=(0.3, 0.1, 0.0)),
    )


def truly(scene: Scene, true_from_model: np.ndarray) -> Scene:
    """The scene with its bodies transformed in the left imager's frame; lights are unchanged."""
    moved = scene.world_from_left @ true_from_model @ np.linalg.inv(scene.world_from_left)
    bodies = []
    for body in scene.bodies:
        vertices = body.mesh.vertices @ moved[:3, :3].T + moved[:3, 3]
        normals = body.mesh.normals
        if normals is not None:
            normals = normals @ moved[:3, :3].T
            normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        mesh = Mesh(
            vertices=np.float32(vertices),
            faces=body.mesh.faces,
            normals=None if normals is None else np.float32(normals),
            uv=body.mesh.uv,
        )
        bodies.append(dataclasses.replace(body, mesh=mesh))
    return dataclasses.replace(scene, bodies=tuple(bodies))


def agree(actual, expected):
    """Assert that renders agree, except for rays that rounding moves across an edge."""
    for side in ("left", "right"):
        for name in LAYERS:
            a, b = (getattr(getattr(layers, side), name) for layers in (actual, expected))
            # Shadow edges and dot flanks amplify the rounding errors of single precision.
            assert np.quantile(np.abs(a - b), 0.98) <= 1e-4 * max(b.max(), 1e-12), name
            assert a.mean() == pytest.approx(b.mean(), rel=1e-3)
        a, b = (getattr(layers, side).depth_m for layers in (actual, expected))
        assert np.nanquantile(np.abs(a / b - 1), 0.99) < 1e-5
    assert np.nanquantile(np.abs(actual.truth.normal - expected.truth.normal), 0.99) < 1e-4
    for name in ("right_sees", "lit"):
        a, b = (getattr(layers.truth, name) for layers in (actual, expected))
        assert (a != b).mean() < 2e-3


def test_a_scaled_model_is_a_scaled_scene():
    """Truth, all lights and disparity equal those of bodies scaled about the left imager.

    The test excludes effects after rendering, which use the true depths.
    """
    scene = tabletop()
    wrong = dataclasses.replace(scene, model_error=ModelError(scale=SCALE))
    actual = direct.layers(mitsuba_scene.MitsubaScene(wrong), small())
    expected = direct.layers(
        mitsuba_scene.MitsubaScene(truly(scene, np.diag([SCALE] * 3 + [1.0]))), small()
    )
    plain = direct.layers(mitsuba_scene.MitsubaScene(scene), small())
    agree(actual, expected)
    assert not np.allclose(actual.left.projector_direct.mean(), plain.left.projector_direct.mean())
    np.testing.assert_allclose(
        actual.truth.depth_m, plain.truth.depth_m * np.float32(SCALE), rtol=1e-4
    )


def test_a_shifted_and_turned_model_is_a_shifted_and_turned_scene():
    """The sky rotates with the world, so ambient light from above is unchanged."""
    scene = dataclasses.replace(tabletop(), ambient=Ambient(gradient=0.0), sun=Sun())
    error = ModelError(shift_m=SHIFT_M, turn_deg=TURN_DEG)
    actual = direct.layers(
        mitsuba_scene.MitsubaScene(dataclasses.replace(scene, model_error=error)), small()
    )
    moved = truly(scene, frames.pose(SHIFT_M, TURN_DEG))
    agree(actual, direct.layers(mitsuba_scene.MitsubaScene(moved), small()))


def test_scale_rotation_and_shift_act_in_this_order():
    """A model point p is at s R p + t, also with interreflection."""
    scene = dataclasses.replace(tabletop(), ambient=Ambient(gradient=0.0), sun=Sun())
    error = ModelError(scale=SCALE, shift_m=SHIFT_M, turn_deg=TURN_DEG)
    true_from_model = frames.pose(SHIFT_M, TURN_DEG) @ np.diag([SCALE] * 3 + [1.0])
    mi_scene = mitsuba_scene.MitsubaScene(dataclasses.replace(scene, model_error=error))
    moved = mitsuba_scene.MitsubaScene(truly(scene, true_from_model))
    actual, expected = (
        indirect.add(direct.layers(each, small()), each, small(), samples=4, seed=3)
        for each in (mi_scene, moved)
    )
    for side in ("left", "right"):
        a, b = (getattr(layers, side).projector_indirect for layers in (actual, expected))
        assert a.mean() == pytest.approx(b.mean(), rel=0.01)
    plain = [
        dataclasses.replace(
            layers,
            left=dataclasses.replace(layers.left, projector_indirect=np.zeros_like(a)),
            right=dataclasses.replace(layers.right, projector_indirect=np.zeros_like(a)),
        )
        for layers in (actual, expected)
    ]
    agree(*plain)


def step(distance_m: float) -> mitsuba_scene.MitsubaScene:
    """A bright sheet with a slanted edge in front of a dark room."""
    sheet = solids.plane(40, 40)
    sheet.apply_translation((20.0, 0.0, 0.0))
    sheet.apply_transform(frames.pose((0.0, 0.0, distance_m), (0.0, 0.0, 8.0)))
    body = solids.body("sheet", sheet, Material(name="white", reflectance=0.9))
    return mitsuba_scene.MitsubaScene(
        Scene(name="step", bodies=(body,), ambient=Ambient(gradient=0.0))
    )


def edge_px(image) -> float:
    """Mean column of the sheet's edge, from the bright share of the image."""
    return float(image.shape[1] * (1 - image.mean(dtype=np.float64) / image.max()) - 0.5)


@pytest.mark.parametrize("error", [-0.02, 0.01])
def test_baseline_error_scales_disparity_and_depth(error):
    """Disparity is f b (1 + e) / z to 0.01 px, so depth is z / (1 + e).

    The test does not include matching.
    """
    sensor = small(baseline_error=error)
    for distance in (0.6, 1.2, 2.4):
        layers = direct.layers(step(distance), sensor, subpixels=8)
        disparity = edge_px(layers.left.ambient) - edge_px(layers.right.ambient)
        expected = sensor.fx_px * sensor.baseline_m * (1 + error) / distance
        assert disparity == pytest.approx(expected, abs=0.01)
        np.testing.assert_allclose(np.nanmax(layers.truth.depth_m), distance, rtol=1e-5)
        depth = depth_from_disparity(
            np.array([disparity]), focal_px=sensor.fx_px, baseline_m=sensor.baseline_m
        )
        assert depth[0] / distance == pytest.approx(1 / (1 + error), abs=0.01 / expected)


def test_baseline_error_of_structured_light_moves_the_projector():
    sensor = presets.load("kinect-v1")
    nominal = dataclasses.replace(sensor, baseline_error=0.015)
    baseline = sensor.baseline_m * 1.015
    part = dataclasses.replace(sensor.projector, position_m=(baseline, 0.0, 0.0))
    true = dataclasses.replace(sensor, baseline_m=baseline, projector=part)
    scene = mitsuba_scene.MitsubaScene(scenes.wall(1.0))
    actual, expected = (direct.layers(scene, each, subpixels=1) for each in (nominal, true))
    assert np.array_equal(actual.left.projector_direct, expected.left.projector_direct)
    assert not np.array_equal(
        actual.left.projector_direct,
        direct.layers(scene, sensor, subpixels=1).left.projector_direct,
    )


def test_aligned_scenes_are_unchanged():
    """Without errors the same scene, sensor and layers are returned."""
    mi_scene, sensor = mitsuba_scene.MitsubaScene(scenes.wall(1.0)), small()
    assert placement.rig_in_model(mi_scene, sensor) == (mi_scene, sensor)
    layers = direct.layers(mi_scene, sensor)
    assert placement.scale_layers(layers, mi_scene.scene) is layers


def test_model_scale_scales_motion():
    """In a model too small by s the rig moves slower by s, so the blur equals the true one."""
    motion = Motion(velocity_m_s=(2.0, 0.0, 0.0), turn_deg_s=(0.0, 20.0, 0.0))
    scene = dataclasses.replace(tabletop(), motion=motion)
    wrong = dataclasses.replace(scene, model_error=ModelError(scale=1.25))
    right = truly(scene, np.diag([1.25] * 3 + [1.0]))
    actual, expected = (
        direct.layers(mitsuba_scene.MitsubaScene(each), small(), exposure_s=0.01)
        for each in (wrong, right)
    )
    agree(actual, expected)
