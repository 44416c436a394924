"""What the check on withheld effects is told of a real camera."""

from __future__ import annotations

from starling.diagnosis.validation.adapters import captured_camera
from starling.sim.effects import setting as setting
from starling.sim.scene.builtin import scenes
from starling.sim.sensor import presets


def test_effects_that_a_camera_has_are_those_off_their_neutral():
    ideal, _ = setting.ideal(presets.load("d435"), scenes.clutter(0))
    of_the_scene = captured_camera._has(ideal)
    assert set(of_the_scene) <= {"ambient", "ambient_gradient"}
    has = {"vignetting": 0.3, "gamma": 1.1, "pixel_locking": 0.05}
    sensor, _ = setting.apply(ideal, scenes.clutter(0), has)
    assert captured_camera._has(sensor) == sorted({*has, *of_the_scene})
