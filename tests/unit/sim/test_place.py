"""Bodies that move in a loaded scene."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import starling
from starling.patterns import InputError
from starling.sim.geometry import frames
from starling.sim.geometry.frames import Pose
from starling.sim.render.mitsuba_scene import MitsubaScene
from starling.sim.scene.builtin import solids
from starling.sim.scene.scene import Body, Material, Scene
from starling.sim.simulate import Shot, simulate

SIZE = ("width=96", "height=72", "fx_px=60", "fy_px=60", "cx_px=47.5", "cy_px=35.5")
SENSOR = starling.load_sensor("d435", edits=SIZE)
PAINT = Material(name="paint")
BEFORE, AFTER = frames.pose((0, 0, 1)), frames.pose((0.1, 0.05, 0.9), (10, 20, 30))


def _scene(ball: Pose) -> Scene:
    things = {"ball": (solids.sphere(0.2), True), "box": (solids.box((0.2, 0.2, 0.2)), False)}
    places = {"ball": ball, "box": frames.pose((-0.3, 0, 1.2))}
    bodies = [
        Body(
            name=name,
            mesh=solids.mesh(solid, smooth=smooth),
            material=PAINT,
            world_from_body=places[name],
        )
        for name, (solid, smooth) in things.items()
    ]
    wall = solids.body("wall", solids.plane(6, 6), PAINT, frames.pose((0, 0, 2)))
    return Scene(name="things", bodies=(wall, *bodies))


def _assert_equal(first: Shot, second: Shot) -> None:
    np.testing.assert_array_equal(first.ir_left, second.ir_left)
    np.testing.assert_array_equal(first.ir_right, second.ir_right)
    np.testing.assert_array_equal(first.layers.truth.depth_m, second.layers.truth.depth_m)
    np.testing.assert_array_equal(first.depth.reason, second.depth.reason)
    np.testing.assert_array_equal(first.depth.depth_m, second.depth.depth_m)


def test_placed_bodies_give_the_bits_of_a_scene_built_anew():
    placed = MitsubaScene(_scene(BEFORE)).place({"ball": AFTER})
    anew = simulate(_scene(AFTER), SENSOR)
    _assert_equal(simulate(placed, SENSOR), anew)
    back = placed.place({"ball": BEFORE})
    _assert_equal(simulate(back, SENSOR), simulate(_scene(BEFORE), SENSOR))


def test_placed_bodies_keep_the_poses_of_others_and_follow_the_camera():
    placed = MitsubaScene(_scene(BEFORE)).place({"ball": AFTER, "box": BEFORE})
    placed = placed.place({"ball": AFTER})
    camera = frames.pose((0.05, 0, 0), (0, 5, 0))
    moved = placed.with_scene(dataclasses.replace(placed.scene, world_from_left=camera))
    bodies = tuple(
        dataclasses.replace(body, world_from_body=BEFORE) if body.name == "box" else body
        for body in _scene(AFTER).bodies
    )
    anew = dataclasses.replace(_scene(AFTER), bodies=bodies, world_from_left=camera)
    _assert_equal(simulate(moved, SENSOR), simulate(anew, SENSOR))


def test_a_pose_moves_the_mesh_as_its_vertices_moved():
    ball = _scene(AFTER).bodies[1]
    mesh = ball.world_mesh
    turned = frames.pose((0, 0, 0), (10, 20, 30))[:3, :3]
    np.testing.assert_allclose(
        mesh.vertices, ball.mesh.vertices @ turned.T + AFTER[:3, 3], atol=1e-6
    )
    assert mesh.normals is not None and ball.mesh.normals is not None
    np.testing.assert_allclose(mesh.normals, ball.mesh.normals @ turned.T, atol=1e-6)


def test_unknown_bodies_and_poses_that_deform_are_refused():
    loaded = MitsubaScene(_scene(BEFORE))
    with pytest.raises(InputError, match="body must be a known name; got 'bowl'"):
        loaded.place({"bowl": AFTER})
    with pytest.raises(InputError, match="world_from_body of ball must be rigid"):
        loaded.place({"ball": 2 * np.eye(4)})
    with pytest.raises(InputError, match="camera must stand outside every body"):
        loaded.place({"ball": np.eye(4)})
    with pytest.raises(InputError, match="scene extent must be at most"):
        MitsubaScene(_scene(BEFORE)).place({"ball": frames.pose((0, 2e4, 1))})
