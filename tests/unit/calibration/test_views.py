"""Where the surface points lie that an imager's pixels show."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calibration.observation import Observation
from calibration.pattern import views
from sim import capture_writer
from sim.scenes import builtin
from sim.sensor import Sensor
from tests.unit.calibration.small_camera import small

SENSOR = small("d415", 320, 180)


def _seen(sensor: Sensor) -> tuple[views.View, ...]:
    """Views of stairs by a camera whose images do not matter."""
    dark = np.zeros((sensor.height, sensor.width), np.float32)
    observation = Observation(
        name="stairs",
        room="stairs",
        info=capture_writer.info_of(sensor, source="drawn", licence="Apache-2.0", notes=""),
        left=dark,
        right=dark,
        scene=builtin.staircase(0.6),
        metric=True,
    )
    return views.of(observation, sensor)


def test_a_baseline_s_error_moves_the_points_that_the_right_imager_sees() -> None:
    """It stands where a longer baseline would put it, and so do the points of its pixels."""
    error = 0.02
    longer = replace(SENSOR, baseline_m=SENSOR.baseline_m * (1 + error))
    for found, true in zip(
        _seen(replace(SENSOR, baseline_error=error)), _seen(longer), strict=True
    ):
        assert found.side == true.side and found.usable.any()
        np.testing.assert_allclose(found.points_m, true.points_m, atol=1e-6)
