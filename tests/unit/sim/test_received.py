"""Light at the lens: parts that scale with the laser's power."""

import dataclasses

import numpy as np
import pytest

from starling.sim.imaging.lens_input import combine_light
from starling.sim.render.layers import ViewLayers
from starling.sim.scene.builtin import scenes
from starling.sim.sensor import presets

ONE = np.ones((4, 5), np.float32)
VIEW = ViewLayers(
    projector_direct=ONE,
    projector_indirect=3 * ONE,
    ambient=0 * ONE,
    other=0 * ONE,
    depth_m=ONE,
    body=np.ones((4, 5), np.uint32),
)
SENSOR, SCENE = presets.load("d435"), scenes.clutter(0)


def laser(flicker: float, interreflection: float, frames: int = 1) -> np.ndarray:
    """Light of the laser at a quarter of a watt (frames, 4, 5)."""
    light = dataclasses.replace(SENSOR.projector, power_w=0.25, flicker=flicker)
    sensor = dataclasses.replace(SENSOR, projector=light)
    scene = dataclasses.replace(SCENE, interreflection=interreflection)
    each = (combine_light(VIEW, scene, sensor, seed=0, frame=frame) for frame in range(frames))
    return np.stack([light.laser for light in each])


def test_interreflection_goes_with_the_power() -> None:
    np.testing.assert_allclose(laser(0.0, 0.5), 0.25 * (1 + 0.5 * 3), rtol=1e-6)


def test_flicker_keeps_the_mean_power() -> None:
    """Law: a log-normal factor of mean 1 and of that relative deviation."""
    each = laser(0.4, 0.0, frames=4000)[:, 0, 0] / 0.25
    assert each.mean() == pytest.approx(1.0, abs=4 * 0.4 / np.sqrt(4000))
    assert each.std() == pytest.approx(0.4, rel=0.1)
