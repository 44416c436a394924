"""Position of surface points in the projector's field, from either imager."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from starling.diagnosis.scenes.strata import projector_tangents
from starling.sim.sensor import presets
from starling.sim.sensor.edits import with_values

SENSOR = with_values(
    presets.load("d435"),
    [("width", 64), ("height", 48), ("cx_px", 31.5), ("cy_px", 23.5), ("fx_px", 64.0)],
)
OFF_PX = 8  # Disparity of the wall.


@pytest.mark.parametrize("error", [0.0, 0.02])
def test_both_imagers_give_the_same_position(error: float) -> None:
    """The right imager is at the true baseline, not at the nominal one."""
    sensor = replace(SENSOR, baseline_error=error)
    depth_m = sensor.fx_px * sensor.baseline_m * (1 + error) / OFF_PX
    wall = np.full((sensor.height, sensor.width), depth_m)
    left = projector_tangents(wall, sensor)
    right = projector_tangents(wall, sensor, right=True)
    np.testing.assert_allclose(right[:, :-OFF_PX], left[:, OFF_PX:], atol=1e-6)


@pytest.mark.parametrize("pixel", [(10, 50), (40, 3), (24, 32)])
def test_the_position_follows_its_definition(pixel: tuple[int, int]):
    """It is the offset from the projector along its x and y axes, divided by that along z."""
    turned = with_values(
        SENSOR,
        [
            ("projector.position_m", [0.03, 0.01, -0.005]),
            ("projector.rotation_deg", [3.0, -5.0, 0.0]),
        ],
    )
    row, column = pixel
    depth_m = np.full((turned.height, turned.width), 1.3)
    x = (column - turned.cx_px) / turned.fx_px * 1.3
    y = (row - turned.cy_px) / turned.fy_px * 1.3
    offset = np.array([x, y, 1.3]) - (0.03, 0.01, -0.005)
    axes = cv2.Rodrigues(np.radians([3.0, -5.0, 0.0]))[0].T  # In the camera's frame.
    along = [float(axis @ offset) for axis in axes]
    position = projector_tangents(depth_m, turned)[row, column]
    assert position == pytest.approx([along[0] / along[2], along[1] / along[2]], abs=1e-6)


def test_unknown_depth_has_no_position():
    hole = np.full((SENSOR.height, SENSOR.width), 1.0)
    hole[3, 4] = np.nan
    position = projector_tangents(hole, SENSOR)
    assert np.isnan(position[3, 4]).all() and np.isfinite(position).sum() == position.size - 2
