"""Depth cameras in MuJoCo: both methods, noise of each reading, and bodies that move."""

from __future__ import annotations

import dataclasses
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import mujoco
import numpy as np
import pytest

import starling
import starling.mujoco
from starling.patterns import InputError
from starling.sim.corrupt import narrow_search
from starling.sim.mujoco import model_scene
from starling.sim.mujoco.buffers import Buffers
from starling.sim.mujoco.library import current
from starling.sim.reading import Reading
from starling.sim.reason import Reason
from starling.sim.render.mitsuba_scene import MitsubaScene
from starling.sim.simulate import expose, render_layers, simulate

SIZE = (160, 120)


def _camera(model: Any, **options: Any) -> starling.mujoco.DepthCamera:
    return starling.mujoco.DepthCamera(model, **{"camera": "top", "size": SIZE, **options})


def _differs(first: Reading, second: Reading) -> bool:
    return bool((first.ir_left != second.ir_left).any())


@pytest.fixture(params=["warp", "trace"])
def method(request: pytest.FixtureRequest) -> str:
    if request.param == "warp":
        request.getfixturevalue("drawing")
    return request.param


def test_readings_have_depth_and_noise_of_their_own(model, data, method):
    camera = _camera(model, by=method, seed=3)
    first, second = camera.read(data), camera.read(data)
    assert np.isfinite(first.depth_m).mean() > 0.5
    assert first.depth_m.shape == (120, 160)
    assert ((first.reason == 0) == np.isfinite(first.depth_m)).all()
    assert _differs(first, second)
    camera.reset()
    np.testing.assert_array_equal(camera.read(data).ir_left, first.ir_left)
    camera.reset(seed=4)
    assert _differs(camera.read(data), first)
    camera.close()
    camera.close()
    with pytest.raises(InputError, match="camera must be open; got a closed one"):
        camera.read(data)


def test_readings_follow_bodies_that_move(model, data, method):
    camera = _camera(model, by=method)
    before = camera.read(data).true_depth_m
    data.qpos[:3] = -0.1, 0, 0.5
    mujoco.mj_forward(model, data)
    after = camera.read(data).true_depth_m
    x, y, z = _seen(data, (-0.1, 0, 0.6))
    assert after[y, x] == pytest.approx(z, abs=0.01) and before[y, x] > z + 0.1


def _seen(data: Any, point: tuple[float, float, float]) -> tuple[int, int, float]:
    """Column, row and depth of a point in the images of the camera `top`."""
    pose = model_scene.camera_pose(data, 0)
    x, y, z = np.linalg.inv(pose)[:3] @ [*point, 1]
    focal = 60 / np.tan(np.deg2rad(30))
    return round(79.5 + focal * x / z), round(59.5 + focal * y / z), float(z)


@pytest.mark.parametrize("sensor", ["d435", "oak-d", "d405"])
def test_traced_readings_are_those_of_the_scene_built_anew(model, data, sensor):
    camera = _camera(model, by="trace", quality="full", sensor=sensor)
    camera.read(data)
    data.qpos[:3] = -0.1, 0, 0.5
    mujoco.mj_forward(model, data)
    camera.reset()
    reading = camera.read(data)
    scene = starling.mujoco.scene(model, data, camera="top")
    anew = simulate(scene, camera.sensor)
    np.testing.assert_array_equal(reading.ir_left, anew.ir_left)
    np.testing.assert_array_equal(reading.true_depth_m, anew.layers.truth.depth_m)
    np.testing.assert_array_equal(reading.depth_m, anew.depth.depth_m)
    np.testing.assert_array_equal(reading.reason, anew.depth.reason)


@pytest.mark.parametrize("sensor", ["d435", "oak-d", "d405"])
def test_scenes_are_built_once(model, data, sensor, monkeypatch):
    """Also those of sensors of visible light, with a mosaic of colours or without."""
    camera = _camera(model, by="trace", sensor=sensor)
    camera.read(data)

    def refuse(self: MitsubaScene, scene: Any) -> None:
        raise AssertionError(scene.name)

    monkeypatch.setattr(MitsubaScene, "__init__", refuse)
    data.qpos[:3] = -0.1, 0, 0.5
    mujoco.mj_forward(model, data)
    assert np.isfinite(camera.read(data).true_depth_m).any()


def test_draft_readings_search_the_disparities_of_the_scene(model, data):
    camera = _camera(model, by="trace")
    reading = camera.read(data)
    scene = starling.mujoco.scene(model, data, camera="top")
    layers = render_layers(MitsubaScene(scene), camera.sensor, quality="draft")
    sensor = narrow_search(camera.sensor, layers.truth.depth_m)
    assert sensor.matcher.search_px < camera.sensor.matcher.search_px
    shot = expose(layers, scene, sensor)
    np.testing.assert_array_equal(reading.ir_left, shot.ir_left)
    np.testing.assert_array_equal(reading.depth_m, shot.depth.depth_m)


@pytest.mark.parametrize("sensor", ["d435", "oak-d"])
def test_methods_agree(drawing, model, data, sensor):
    """Images differ by shadows and gloss alone, also of a camera that sees visible colours."""
    readings = [_camera(model, by=method, sensor=sensor).read(data) for method in ("warp", "trace")]
    warped, traced = (reading.ir_left.ravel().astype(float) for reading in readings)
    assert np.corrcoef(warped, traced)[0, 1] > 0.9


def test_three_views_know_what_the_right_imager_and_the_projector_see(drawing, model, data):
    sensor = starling.load_sensor("d435")
    exact = starling.simulate(
        starling.mujoco.scene(model, data, camera="top"),
        _camera(model, by="trace", sensor=sensor).sensor,
    ).layers.truth
    shares = []
    for views in (1, 3):
        reading = _camera(model, sensor=sensor, views=views).read(data)
        shares.append(
            [(reading.lit != exact.lit).mean(), (reading.right_sees != exact.right_sees).mean()]
        )
    assert shares[1][0] < shares[0][0] and shares[1][1] < shares[0][1]


def test_a_camera_that_sees_nothing_returns_no_depth(model, data, method):
    reading = _camera(model, camera="sky", by=method).read(data)
    assert np.isnan(reading.depth_m).all()
    assert (reading.reason == Reason.NO_SURFACE).all()


def test_images_are_the_sensor_s_or_the_camera_s(drawing, model):
    native = starling.load_sensor("d435")
    plain = starling.mujoco.DepthCamera(model, "plain", "d435").sensor
    assert (plain.width, plain.fx_px) == (native.width, native.fx_px)
    stated = starling.mujoco.DepthCamera(model, "top", "d435")
    assert (stated.sensor.width, stated.sensor.height) == (320, 240)
    assert stated.camera_matrix[0, 0] == pytest.approx(120 / np.tan(np.deg2rad(30)))
    assert _camera(model, camera="plain").sensor.width == 160


def test_the_left_imager_stands_beside_the_middle_of_the_housing(drawing, model, data):
    """A shift to the left moves what is seen to the right."""
    middle = _camera(model).read(data).true_depth_m
    camera = _camera(model, camera_from_left_m=(-0.0175, 0, 0))
    pose = model_scene.camera_pose(data, 0)
    buffers = Buffers(model, camera.sensor, model_scene.GROUPS)
    pose = pose @ _shift(-0.0175)
    buffers.update(data, pose)
    expected, _ = buffers.draw(pose)
    np.testing.assert_allclose(camera.read(data).true_depth_m, expected, rtol=1e-6)
    assert (expected != middle).any()


def _shift(x: float) -> np.ndarray:
    pose = np.eye(4)
    pose[0, 3] = x
    return pose


def test_a_temporal_filter_goes_on_from_reading_to_reading(drawing, model, data):
    sensor = starling.load_sensor("d435", edits=["post.temporal_alpha=0.4"])
    camera = _camera(model, sensor=sensor)
    first = camera.read(data)
    assert first.history is not None
    second = camera.read(data)
    camera.reset()
    camera._frame = 1
    alone = camera.read(data)
    assert (np.nan_to_num(second.depth_m) != np.nan_to_num(alone.depth_m)).any()


def test_odd_arguments_are_refused(model):
    for options, message in (
        ({"by": "raster"}, "by must be a known name; got 'raster'"),
        ({"views": 2}, "views must be 1 or 3; got 2"),
        ({"seed": -1}, "seed must be"),
        ({"camera_from_left_m": (5.0, 0, 0)}, "camera_from_left_m.x must be"),
        ({"camera": "tip"}, "camera must be a known name"),
        ({"quality": "best", "by": "trace"}, "quality must be a known name"),
        ({"quality": "best", "by": "warp"}, "quality must be a known name"),
        ({"sensor": "d4"}, "d4"),
        ({"groups": 3}, "groups must be of type tuple; got 3"),
        ({"groups": (6,)}, r"entry of groups must be an integer in \[0, 5\]; got 6"),
        ({"size": 160}, r"size must be \(width, height\); got 160"),
        ({"size": ()}, r"size must be \(width, height\); got \(\)"),
        ({"size": (0, 0)}, r"entry of size must be an integer in \[1, \d+\]; got 0. Give \(width"),
        ({"residual": "hybrid", "by": "trace"}, "residual must be a loaded model"),
    ):
        with pytest.raises(InputError, match=message):
            _camera(model, **options)
    with pytest.raises(InputError, match=r"model must be of type MjModel; got 'arm\.xml'. Load"):
        _camera("arm.xml")
    camera = _camera(model, by="trace")
    with pytest.raises(InputError, match="seed must be"):
        camera.reset(seed=-1)


def test_machines_that_cannot_draw_are_refused(model, monkeypatch):
    def refuse(width: int, height: int) -> None:
        raise RuntimeError("no display")

    monkeypatch.setenv("MUJOCO_GL", "glfw")
    monkeypatch.setattr(mujoco, "GLContext", refuse, raising=False)
    with pytest.raises(InputError, match=r"MuJoCo must be able to draw; got no display\..*libegl1"):
        _camera(model)


def test_any_thread_may_read(drawing, model, data):
    camera = _camera(model)
    first = camera.read(data)
    camera.reset()
    with ThreadPoolExecutor(1) as thread:
        second = thread.submit(camera.read, data).result()
    np.testing.assert_array_equal(second.ir_left, first.ir_left)
    camera.close()


def test_contexts_of_older_releases_are_made_current():
    calls = []

    class Older:
        def make_current(self) -> None:
            calls.append("current")

    with current(Older()):
        assert calls == ["current"]


def test_a_missing_package_is_named(monkeypatch):
    import sys

    from starling.sim.mujoco.library import mujoco as load

    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(InputError, match=r"starling\.mujoco needs mujoco"):
        load()


def test_sensors_of_one_imager_are_read_too(drawing, model, data):
    with pytest.warns(UserWarning, match="has no dots"):
        reading = _camera(model, sensor="kinect-v1").read(data)
    assert reading.ir_right is None and np.isfinite(reading.depth_m).any()


def test_models_residual_removes_depth(drawing, model, data):
    def residual(shot: Any, sensor: Any, *, seed: int, frame: int) -> Any:
        nothing = np.full_like(shot.depth.depth_m, np.nan)
        reason = np.full_like(shot.depth.reason, Reason.UNKNOWN)
        return dataclasses.replace(shot.depth, depth_m=nothing, reason=reason)

    reading = _camera(model, residual=residual).read(data)
    assert np.isnan(reading.depth_m).all()
