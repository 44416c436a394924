"""Where in the projector's field a surface point lies, whichever imager it is seen by."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from diagnosis import projector_frame
from sim import sensors
from sim.sensor_edits import with_values

SENSOR = with_values(
    sensors.load("d435"),
    [("width", 64), ("height", 48), ("cx_px", 31.5), ("cy_px", 23.5), ("fx_px", 64.0)],
)
OFF_PX = 8  # Disparity of the wall.


@pytest.mark.parametrize("error", [0.0, 0.02])
def test_a_point_lies_where_both_imagers_see_it(error: float) -> None:
    """The right imager stands at the true baseline, not at the nominal one."""
    sensor = replace(SENSOR, baseline_error=error)
    depth_m = sensor.fx_px * sensor.baseline_m * (1 + error) / OFF_PX
    wall = np.full((sensor.height, sensor.width), depth_m)
    left = projector_frame.tangents(wall, sensor)
    right = projector_frame.tangents(wall, sensor, right=True)
    np.testing.assert_allclose(right[:, :-OFF_PX], left[:, OFF_PX:], atol=1e-6)
