"""MuJoCo models as scenes: what is shown, cameras, colours, and the depth that MuJoCo draws."""

from __future__ import annotations

import dataclasses
from typing import Any

import cv2
import mujoco
import numpy as np
import pytest

import starling
import starling.mujoco
from starling.patterns import InputError
from starling.sim.geometry.pinhole import Pinhole
from starling.sim.imaging import colour_picture
from starling.sim.mujoco import looks, model_scene
from starling.sim.mujoco.buffers import Buffers
from starling.sim.render.mitsuba_scene import MitsubaScene
from starling.sim.scene import colours
from starling.sim.sensor import edits
from starling.sim.sensor.sensor import Colour, Sensor
from starling.sim.simulate import render_layers

SHOWN = 13


def _sensor(model: Any, camera: str, size: tuple[int, int] = (320, 240)) -> Sensor:
    number = model_scene.camera_number(model, camera)
    matrix = model_scene.intrinsics(model, number, size)
    return edits.with_camera(starling.load_sensor("d435"), matrix, size)


def _off_edges(image: np.ndarray) -> np.ndarray:
    """Mask of pixels at least two from a jump in the image (h, w)."""
    known = np.nan_to_num(image, nan=99.0)
    kernel = np.ones((5, 5))
    jump = cv2.dilate(known, kernel) - cv2.erode(known, kernel)
    return jump < 0.02 * known


def test_geoms_of_other_groups_and_transparent_ones_are_not_shown(model, data):
    scene = starling.mujoco.scene(model, data, camera="top")
    names = {body.name for body in scene.bodies}
    assert {"floor", "box", "hills", "sheet", "ball/14"} <= names
    assert not names & {"hull", "clear"} and len(names) == SHOWN
    only = starling.mujoco.scene(model, data, groups=(3,))
    assert [body.name for body in only.bodies] == ["hull"]
    with pytest.raises(InputError, match="must have geoms in the groups 5; got groups \\[0, 3\\]"):
        starling.mujoco.scene(model, data, groups=(5,))


def test_flexible_bodies_are_left_out_with_a_warning():
    flexible = mujoco.MjModel.from_xml_string(
        """<mujoco><worldbody><geom size=".1"/><camera name="top" pos="0 0 1"/>
        <flexcomp name="cloth" type="grid" count="3 3 1"
        spacing=".1 .1 .1" dim="2"/></worldbody></mujoco>"""
    )
    state = mujoco.MjData(flexible)
    mujoco.mj_forward(flexible, state)
    with pytest.warns(UserWarning, match="flex are not shown") as warned:
        scene = starling.mujoco.scene(flexible, state)
    assert len(scene.bodies) == 1
    with pytest.warns(UserWarning, match="flex are not shown") as warned_too:
        camera = starling.mujoco.DepthCamera(flexible, "top", by="trace", size=(64, 48))
        camera.read(state)
    assert [each.filename for each in (*warned, *warned_too)] == [__file__, __file__]


def test_unknown_cameras_are_refused_with_those_there_are(model, data):
    with pytest.raises(InputError, match=r"camera must be a known name; got 'tip'.*top"):
        starling.mujoco.scene(model, data, camera="tip")
    with pytest.raises(InputError, match="camera must be a perspective camera"):
        starling.mujoco.scene(model, data, camera="flat")
    bare = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><geom size=".1"/></worldbody></mujoco>'
    )
    with pytest.raises(InputError, match=r"must be a camera of the model; got 'top'\. It has none"):
        starling.mujoco.scene(bare, mujoco.MjData(bare), camera="top")
    with pytest.raises(InputError, match="data must have current kinematics"):
        starling.mujoco.scene(bare, mujoco.MjData(bare))


def test_intrinsics_follow_the_field_or_the_lens(model):
    top, shifted = (model_scene.camera_number(model, name) for name in ("top", "shifted"))
    matrix = model_scene.intrinsics(model, top, (320, 240))
    assert matrix[0, 0] == matrix[1, 1] == pytest.approx(120 / np.tan(np.deg2rad(30)))
    assert matrix[:2, 2].tolist() == [159.5, 119.5]
    matrix = model_scene.intrinsics(model, shifted, (160, 120))
    assert matrix[0, 0] == pytest.approx(120) and matrix[1, 1] == pytest.approx(108)
    assert matrix[:2, 2].tolist() == pytest.approx([59.5, 71.5])
    assert model_scene.resolution(model, model_scene.camera_number(model, "plain")) is None


@pytest.mark.parametrize("camera", ["top", "shifted"])
def test_depth_is_that_of_mujoco_s_own_renderer(drawing, model, data, camera):
    """The camera matrix is the one that MuJoCo draws the camera with."""
    sensor = _sensor(model, camera)
    buffers = Buffers(model, sensor, model_scene.GROUPS)
    pose = model_scene.camera_pose(data, model_scene.camera_number(model, camera))
    buffers.update(data, pose)
    seen, _ = buffers.draw(pose)
    buffers.close()
    with mujoco.Renderer(model, sensor.height, sensor.width) as renderer:
        renderer.enable_depth_rendering()
        renderer.update_scene(data, camera)
        expected = renderer.render()
    same = _off_edges(expected) & _off_edges(seen)
    assert same.mean() > 0.5
    np.testing.assert_allclose(seen[same], expected[same], atol=2e-4)


@pytest.mark.parametrize("camera", ["top", "shifted"])
def test_traced_truth_is_mujoco_s_depth(drawing, model, data, camera):
    """Off edges all pixels agree to a millimetre, for all kinds of geoms."""
    sensor = _sensor(model, camera)
    scene = starling.mujoco.scene(model, data, camera=camera)
    traced = render_layers(MitsubaScene(scene), sensor).truth.depth_m
    buffers = Buffers(model, sensor, model_scene.GROUPS)
    buffers.update(data, scene.world_from_left)
    drawn, _ = buffers.draw(scene.world_from_left)
    buffers.close()
    same = _off_edges(traced) & _off_edges(drawn)
    assert same.mean() > 0.5
    assert np.abs(traced - drawn)[same].max() < 1e-3


def test_colours_are_those_that_mujoco_draws(drawing, model, data):
    """Planes, boxes, round solids and meshes, with flat and cubic textures."""
    sensor = _sensor(model, "top", (640, 480))
    scene = starling.mujoco.scene(model, data, camera="top")
    even = dataclasses.replace(scene.ambient, gradient=0.0)
    scene = dataclasses.replace(scene, ambient=even)
    camera = Colour(position_m=(0.0, 0.0, 0.0), **dataclasses.asdict(Pinhole.from_camera(sensor)))
    picture = colour_picture.picture(scene, dataclasses.replace(sensor, colour=camera))
    buffers = Buffers(model, sensor, model_scene.GROUPS)
    buffers.update(data, scene.world_from_left)
    _, drawn = buffers.draw(scene.world_from_left, colours=True)
    buffers.close()
    assert drawn is not None
    assert np.corrcoef(picture.ravel(), drawn.ravel())[0, 1] > 0.98
    names = [body.name for body in scene.bodies]
    seen = render_layers(MitsubaScene(scene), sensor).truth.material
    for number, name in enumerate(names, start=1):
        part = cv2.erode((seen == number).astype(np.uint8), np.ones((3, 3))) > 0
        if name in ("steel", "glaze", "hills") or part.sum() < 50:
            continue  # One colour.
        correlation = np.corrcoef(picture[part].ravel(), drawn[part].ravel())[0, 1]
        assert correlation > 0.9, name


@pytest.mark.parametrize(
    ("metallic", "roughness", "kind"),
    [(0.51, 0.2, "metal"), (0.5, 0.5, "glossy"), (0.5, 0.51, "diffuse"), (0.0, -1.0, "diffuse")],
)
def test_kinds_change_at_half_metallic_and_above_half_rough(metallic, roughness, kind):
    text = f"""<mujoco>
    <asset><material name="m" metallic="{metallic}" roughness="{roughness}"/></asset>
    <worldbody><geom name="g" size=".1" material="m"/></worldbody></mujoco>"""
    assert looks.body(mujoco.MjModel.from_xml_string(text), 0, "g").material.kind == kind


def test_materials_follow_metal_roughness_and_colour(model):
    def material(name: str) -> Any:
        return looks.body(model, model.geom(name).id, name).material

    steel, glaze, hills = material("steel"), material("glaze"), material("hills")
    assert (steel.kind, steel.roughness) == ("metal", pytest.approx(0.04))
    assert (glaze.kind, glaze.roughness) == ("glossy", pytest.approx(0.01))
    assert hills.kind == "diffuse"
    green = colours.linear(np.array([51, 153, 51], np.uint8))
    np.testing.assert_allclose(hills.rgb, green, rtol=1e-5)
    assert hills.reflectance == pytest.approx(0.25 + 0.6 * green[1])
