"""Surface points of an imager's pixels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from starling.calibration.fit_sensor import without_waves
from starling.calibration.observation import Observation
from starling.calibration.pattern import views
from starling.sim import metrics
from starling.sim.captures import writer
from starling.sim.scene.builtin import scenes
from starling.sim.sensor.edits import with_values
from starling.sim.sensor.sensor import Sensor
from tests.unit.calibration.small_camera import small

SENSOR = small("d415", 320, 180)


def _seen(sensor: Sensor, **changes: object) -> tuple[views.PatternView, ...]:
    """Return views of stairs; image contents are not used."""
    dark = np.zeros((sensor.height, sensor.width), np.float32)
    observation = Observation(
        name="stairs",
        room="stairs",
        info=writer.info_of(sensor, source="drawn", licence="Apache-2.0", notes=""),
        left=dark,
        right=dark,
        scene=scenes.staircase(0.6),
        metric=True,
    )
    return views.make_views(replace(observation, **changes), sensor)


def test_a_baseline_error_moves_the_right_imagers_points() -> None:
    """A baseline error gives the same points as a longer baseline."""
    error = 0.02
    longer = replace(SENSOR, baseline_m=SENSOR.baseline_m * (1 + error))
    for result, true in zip(
        _seen(replace(SENSOR, baseline_error=error)), _seen(longer), strict=True
    ):
        assert result.side == true.side and result.usable.any()
        np.testing.assert_allclose(result.points_m, true.points_m, atol=1e-6)


def test_a_misaligned_imager_has_unknown_border_points() -> None:
    """Pixels of an image shifted by 3 px and 2 px show the points of the shifted rays."""
    off = [("right.alignment.offset_x_px", 3.0), ("right.alignment.offset_y_px", 2.0)]
    sensor = with_values(without_waves(SENSOR), off)
    points = _seen(sensor, scene=scenes.wall(1.0))[1].points_m
    known = np.isfinite(points[..., 2])
    rows, columns = np.indices(known.shape)
    for axis, place, moved, centre in ((0, columns, 3, SENSOR.cx_px), (1, rows, 2, SENSOR.cy_px)):
        shift = SENSOR.baseline_m if axis == 0 else 0.0
        tangent = np.asarray((points[..., axis] - shift) / points[..., 2])
        expected = (place - moved - centre) / SENSOR.fx_px
        np.testing.assert_allclose(tangent[known], expected[known], atol=2e-5)
    assert not known[:, :3].any() and not known[:2].any()
    assert known[5:-5, 6:-5].all()


def test_saturated_pixels_and_those_near_edges_are_unusable() -> None:
    plain = _seen(SENSOR)[0]
    burnt = np.zeros((SENSOR.height, SENSOR.width), np.float32)
    burnt[60:80, 100:140] = SENSOR.left.ceiling_dn
    result = _seen(SENSOR, left=burnt)[0].usable
    assert plain.usable[60:80, 100:140].any() and not result[60:80, 100:140].any()
    expected = plain.usable.copy()
    expected[60:80, 100:140] = False
    np.testing.assert_array_equal(result, expected)
    disparity = SENSOR.focal_baseline_px_m / plain.points_m[..., 2]
    edges = metrics.depth_edges(disparity)
    assert edges.any() and not plain.usable[edges].any()


def test_left_pixels_without_reference_are_unusable() -> None:
    """A metric surface does not need the reference."""
    truth = np.ones((SENSOR.height, SENSOR.width), np.float32)
    truth[:, 100:140] = np.nan
    plain = _seen(SENSOR)
    left, right = _seen(SENSOR, truth_m=truth, metric=False)
    assert plain[0].usable[:, 100:140].any() and not left.usable[:, 100:140].any()
    np.testing.assert_array_equal(left.usable[:, 140:], plain[0].usable[:, 140:])
    np.testing.assert_array_equal(right.usable, plain[1].usable)
    metric = _seen(SENSOR, truth_m=truth)[0]
    np.testing.assert_array_equal(metric.usable, plain[0].usable)
