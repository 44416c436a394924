"""Where in the projector's field a surface point lies, whichever imager it is seen by."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from starling.diagnosis.scenes import projector_frame
from starling.sim.sensor import presets
from starling.sim.sensor.edits import with_values

SENSOR = with_values(
    presets.load("d435"),
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


@pytest.mark.parametrize("pixel", [(10, 50), (40, 3), (24, 32)])
def test_a_point_lies_where_the_projector_s_own_axes_have_it(pixel: tuple[int, int]):
    """By the definition: its offset from the projector along that one's axes, over the third."""
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
    axes = cv2.Rodrigues(np.radians([3.0, -5.0, 0.0]))[0].T  # What its axes are in the camera's.
    along = [float(axis @ offset) for axis in axes]
    found = projector_frame.tangents(depth_m, turned)[row, column]
    assert found == pytest.approx([along[0] / along[2], along[1] / along[2]], abs=1e-6)


def test_where_there_is_no_depth_there_is_no_place():
    hole = np.full((SENSOR.height, SENSOR.width), 1.0)
    hole[3, 4] = np.nan
    found = projector_frame.tangents(hole, SENSOR)
    assert np.isnan(found[3, 4]).all() and np.isfinite(found).sum() == found.size - 2
