"""All rays of a scene are traced in one Mitsuba scene.

Rationale: an OptiX kernel knows one scene. Rays into a second scene hit nothing on a GPU, without
an error; on CPUs they work.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import pytest

from starling.sim import simulate
from starling.sim.differentiable import light
from starling.sim.geometry import frames
from starling.sim.render import backend
from starling.sim.render.mitsuba_scene import MitsubaScene
from starling.sim.scene.builtin import solids
from starling.sim.scene.scene import Finish, Material, Scene, Sun
from starling.sim.sensor import presets
from starling.sim.sensor.sensor import Projector


@pytest.fixture
def traced_scenes(monkeypatch: pytest.MonkeyPatch) -> set[int]:
    """Return the identities of scenes in which rays were traced."""
    mi, scenes = backend.mitsuba(), set()
    for name in ("ray_intersect", "ray_test"):
        traced = getattr(mi.Scene, name)

        def spy(scene: Any, *rest: Any, traced: Any = traced, **more: Any) -> Any:
            scenes.add(id(scene))
            return traced(scene, *rest, **more)

        monkeypatch.setattr(mi.Scene, name, spy)
    return scenes


def test_rays_are_traced_in_one_scene(traced_scenes: set[int]) -> None:
    sheet, matt = solids.plane(8, 8), Material(name="white", reflectance=0.6)
    things = {
        "wall": (sheet, matt, 1.0),
        "pane": (sheet, matt, 0.9),
        "glass": (solids.box((4, 4, 0.005)), Material(name="glass", kind="glass"), 0.5),
        "mirror": (solids.plane(0.2, 0.2), Material(name="mirror", kind="mirror"), 0.8),
    }
    bodies = tuple(
        solids.body(name, mesh, material, frames.pose((0, 0, distance_m)))
        for name, (mesh, material, distance_m) in things.items()
    )
    scene = Scene(
        name="test",
        bodies=bodies,
        finish=Finish(of="pane", transparency=0.5),
        sun=Sun(irradiance_w_m2=1.0, towards=(0.0, 0.0, -1.0)),
        other_projector=Projector(power_w=0.1, position_m=(0.2, 0.0, 0.0)),
        interreflection=1.0,
    )
    sensor = dataclasses.replace(
        presets.load("d435"), width=64, height=48, fx_px=60.0, fy_px=60.0, cx_px=31.5, cy_px=23.5
    )
    stage = MitsubaScene(scene)
    simulate.simulate(stage, sensor, samples=1)
    assert traced_scenes == {id(stage.mitsuba)}
    traced_scenes.clear()
    light.trace(stage, sensor, "left")
    assert traced_scenes == {id(stage.mitsuba)}
