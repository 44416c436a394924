"""The description of a real camera for the validation."""

from __future__ import annotations

from starling.diagnosis.validation.adapters import cameras
from starling.sim.effects import setting
from starling.sim.scene.builtin import scenes
from starling.sim.sensor import presets


def test_camera_has_the_effects_that_are_not_neutral():
    ideal, _ = setting.ideal(presets.load("d435"), scenes.clutter(0))
    of_the_scene = cameras.existing_effects(ideal)
    assert set(of_the_scene) <= {"ambient", "ambient_gradient"}
    has = {"vignetting": 0.3, "gamma": 1.1, "pixel_locking": 0.05}
    sensor, _ = setting.apply(ideal, scenes.clutter(0), has)
    assert cameras.existing_effects(sensor) == sorted({*has, *of_the_scene})
