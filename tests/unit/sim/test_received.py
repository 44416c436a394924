"""Light that an imager receives: what goes with the laser's power."""

import dataclasses

import numpy as np

from sim import sensors
from sim.layers import View
from sim.light.received import received
from sim.scenes import builtin


def test_interreflection_goes_with_the_power() -> None:
    one = np.ones((4, 5), np.float32)
    view = View(
        projector_direct=one,
        projector_indirect=3 * one,
        ambient=0 * one,
        other=0 * one,
        depth_m=one,
        body=np.ones((4, 5), np.uint32),
    )
    sensor = sensors.load("d435")
    light = dataclasses.replace(sensor.projector, power_w=0.25, flicker=0.0)
    sensor = dataclasses.replace(sensor, projector=light)
    scene = dataclasses.replace(builtin.clutter(0), interreflection=0.5)
    found = received(view, scene, sensor, seed=0, frame=0).laser
    np.testing.assert_allclose(found, 0.25 * (1 + 0.5 * 3), rtol=1e-6)
