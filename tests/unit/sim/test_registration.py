"""Depth in the colour camera's image: positions, occlusion and holes."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from starling.patterns import InputError
from starling.sim.geometry import frames
from starling.sim.sensor import presets
from starling.sim.sensor.sensor import Colour, Sensor
from starling.sim.stereo import registration

SIZE = (120, 160)


def _sensor(position_m: tuple[float, float, float], scale: float = 1.0) -> Sensor:
    height, width = SIZE
    colour = Colour(
        width=round(width * scale),
        height=round(height * scale),
        fx_px=100 * scale,
        fy_px=100 * scale,
        cx_px=80 * scale,
        cy_px=60 * scale,
        position_m=position_m,
    )
    return dataclasses.replace(
        presets.load("d435"),
        width=width,
        height=height,
        fx_px=100.0,
        fy_px=100.0,
        cx_px=80.0,
        cy_px=60.0,
        colour=colour,
    )


def _box(near: float = 1.0, far: float = 2.0) -> np.ndarray:
    depth = np.full(SIZE, far, np.float32)
    depth[40:80, 60:100] = near
    return depth


def test_same_pose_gives_the_same_depth_except_at_near_edges() -> None:
    seen = registration.register(_box(), _sensor((0.0, 0.0, 0.0)))
    grown = _box()
    grown[40:81, 60:101] = 1.0
    assert np.array_equal(seen, grown)


def test_parallax_is_focal_length_times_offset_over_depth() -> None:
    """A camera to the left sees objects further right, near ones more: f t / z = 5 and 2.5 px."""
    seen = registration.register(_box(), _sensor((-0.05, 0.0, 0.0)))
    row = seen[60]
    assert np.flatnonzero(row == 1.0)[[0, -1]].tolist() == [65, 105]
    assert np.isnan(row[:2]).all()
    # The colour camera looks behind the left edge of the box; the depth camera could not.
    assert np.isnan(row[63:65]).all()
    assert row[106] == 2.0


def test_depth_is_along_the_colour_cameras_own_axis() -> None:
    seen = registration.register(np.full(SIZE, 2.0, np.float32), _sensor((0.0, 0.0, 0.3)))
    assert np.nanmax(np.abs(seen - 1.7)) < 1e-6


@pytest.mark.parametrize("scale", [0.5, 2.0])
def test_higher_resolution_leaves_no_grid_of_holes(scale: float) -> None:
    seen = registration.register(_box(), _sensor((0.0, 0.0, 0.0), scale))
    assert seen.shape == (round(120 * scale), round(160 * scale))
    assert np.isfinite(seen[2:-2, 2:-2]).all()


def test_holes_remain_and_points_behind_the_camera_are_ignored() -> None:
    depth = _box()
    depth[10:20] = np.nan
    seen = registration.register(depth, _sensor((0.0, 0.0, 0.0)))
    assert np.isnan(seen[11:20, 5:-5]).all()
    assert np.isnan(registration.register(_box(), _sensor((0.0, 0.0, 2.5)))).all()


def test_a_rotated_camera_sees_the_points_where_they_project() -> None:
    """Each depth pixel's point is found at its pixel of the colour camera, at its depth there."""
    sensor = _sensor((0.03, -0.02, 0.01))
    assert sensor.colour is not None
    colour = dataclasses.replace(
        sensor.colour, rotation_deg=(4.0, -3.0, 5.0), fx_px=90.0, fy_px=110.0, cx_px=70.0
    )
    rows, columns = np.mgrid[: SIZE[0], : SIZE[1]].astype(float)
    depth = (2 + 0.002 * columns - 0.003 * rows).astype(np.float32)
    seen = registration.register(depth, dataclasses.replace(sensor, colour=colour))
    rays = np.stack([(columns - 80) / 100, (rows - 60) / 100, np.ones(SIZE), 1 / depth], -1)
    pose = frames.pose(colour.position_m, colour.rotation_deg)
    x, y, z, _ = np.moveaxis((rays * depth[..., None]) @ np.linalg.inv(pose).T, -1, 0)
    u = np.rint(x / z * 90 + 70).astype(int)
    v = np.rint(y / z * 110 + 60).astype(int)
    inside = (u >= 0) & (u < SIZE[1]) & (v >= 0) & (v < SIZE[0])
    assert inside.mean() > 0.6
    np.testing.assert_allclose(seen[v[inside], u[inside]], z[inside], atol=0.012)
    assert abs(np.median(seen[v[inside], u[inside]] - z[inside])) < 0.006


def test_a_sensor_without_colour_camera_is_refused() -> None:
    sensor = dataclasses.replace(presets.load("d435"), colour=None)
    with pytest.raises(InputError, match=r"needs a colour camera; got none in d435"):
        registration.register(_box(), sensor)
