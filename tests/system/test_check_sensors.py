"""Simulated figures of a small camera follow the laws that data sheets rely on."""

from __future__ import annotations

import math
from typing import Any

import pytest

from starling.sim.commands.check_sensors import check, planes
from starling.sim.commands.check_sensors.measurement import CameraMeasurement
from starling.sim.sensor import presets
from starling.sim.sensor.datasheets import StatedFigure
from starling.sim.sensor.edits import with_values
from starling.sim.sensor.sensor import Sensor

pytestmark = pytest.mark.slow

WIDTH, HEIGHT = 320, 120
SEARCH_PX = 48  # As in the D435's full image, the search ends at 0.17 m.


def _small() -> Sensor:
    """A D435 of fewer pixels over the same width of field, with a projector of 1 W."""
    preset = presets.load("d435")
    scale = WIDTH / preset.width
    changes = {
        "width": WIDTH,
        "height": HEIGHT,
        "fx_px": preset.fx_px * scale,
        "fy_px": preset.fy_px * scale,
        "cx_px": (WIDTH - 1) / 2,
        "cy_px": (HEIGHT - 1) / 2,
        "matcher.search_px": SEARCH_PX,
        "projector.power_w": 1.0,
        "projector.dot_density": 0.25,  # The pixels are 2.65 times as wide.
    }
    return with_values(preset, changes.items())


@pytest.fixture(scope="module")
def camera() -> CameraMeasurement:
    return CameraMeasurement(_small())


def _simulated(
    camera: CameraMeasurement, figure: str, value: float, distance_m: float | None, **options: Any
) -> float:
    stated = StatedFigure(
        figure=figure,
        value=(value,),
        distance_m=distance_m,
        source="test",
        **options,
    )
    comparison = check.compare(stated, camera)
    assert comparison.simulated is not None
    return comparison.simulated


def test_noise_grows_with_distance(camera: CameraMeasurement) -> None:
    near, far = (_simulated(camera, "plane_rms_pct", 2.0, z) for z in (0.5, 1.5))
    assert far > 1.5 * near  # To first order three times.
    assert _simulated(camera, "accuracy_pct", 2.0, 0.5) < near * 2
    assert _simulated(camera, "fill_pct", 99.0, 0.5) > 95
    assert camera.noise_mm(0.5) == pytest.approx(10 * near * 0.5, rel=0.3)


def test_temporal_noise_is_below_the_noise_of_the_plane(camera: CameraMeasurement) -> None:
    """Laser speckle and the matcher's errors are equal in all frames."""
    over_frames = _simulated(camera, "temporal_noise_pct", 1.0, 1.0)
    assert 0 < over_frames < _simulated(camera, "plane_rms_pct", 1.0, 1.0)


@pytest.mark.parametrize("distance_m", [0.5, 1.0])
def test_left_band_is_f_b_over_z(camera: CameraMeasurement, distance_m: float) -> None:
    """The matcher's window and its checks move the border by less than 4 columns."""
    band_px = _simulated(camera, "left_band_pct", 5.0, distance_m) * WIDTH / 100
    expected_px = camera.sensor.focal_baseline_px_m / distance_m
    assert band_px == pytest.approx(expected_px, abs=4)


def test_search_limits_the_nearest_distance(camera: CameraMeasurement) -> None:
    nearest_m = _simulated(camera, "minimum_distance_m", 0.2, None)
    assert nearest_m == pytest.approx(camera.sensor.focal_baseline_px_m / (SEARCH_PX - 1), rel=0.08)


def test_light_limits_the_farthest_distance(camera: CameraMeasurement) -> None:
    dim = CameraMeasurement(with_values(_small(), [("projector.power_w", 0.02)]))
    farthest_m = [_simulated(item, "maximum_distance_m", 3.0, None) for item in (dim, camera)]
    assert farthest_m[0] < farthest_m[1]


def test_blank_walls_need_the_projector(camera: CameraMeasurement) -> None:
    assert _simulated(camera, "fill_without_projector_pct", 50.0, 1.0) < 50
    textured = _simulated(camera, "fill_without_projector_pct", 50.0, 1.0, target="textured")
    assert textured > 90


def test_sunlight_outshines_dots_but_not_texture(camera: CameraMeasurement) -> None:
    assert _simulated(camera, "sunlight_change_pct", 0.0, 1.0) < -50
    assert _simulated(camera, "sunlight_change_pct", 0.0, 1.0, target="textured") > -5


def test_cameras_without_depth_have_no_errors() -> None:
    """Without dots a blank wall has no depth, so figures are NaN and missed."""
    dark = CameraMeasurement(with_values(_small(), [("projector.power_w", 0.0)]))
    for figure in ("accuracy_pct", "plane_rms_pct", "temporal_noise_pct"):
        stated = StatedFigure(figure=figure, value=(2.0,), distance_m=1.0, source="test")
        comparison = check.compare(stated, dark)
        assert comparison.simulated is not None and math.isnan(comparison.simulated)
        assert comparison.outcome == "missed"
    # Passive cameras are measured on a textured target.
    assert 0 < dark.noise_mm(1.0) < 100


def test_strips_measure_as_whole_images() -> None:
    sensor = _small()
    view = planes.FlatTarget(distance_m=0.7)
    whole, strip = (planes.measure(item, view) for item in (sensor, planes.strip(sensor)))
    assert strip.plane_rms_pct == pytest.approx(whole.plane_rms_pct, rel=0.3)
    assert strip.fill_pct == pytest.approx(whole.fill_pct, abs=3)
