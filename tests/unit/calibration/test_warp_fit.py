"""The fitted warp of the right image, against a known warp."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from starling.calibration import heldout
from starling.calibration.geometry import warp_fit
from starling.calibration.geometry.warp_fit import COLUMNS, fit_warp
from starling.calibration.observation import Observation
from starling.patterns.errors import InputError
from starling.sim.captures import writer
from starling.sim.render.mitsuba_scene import MitsubaScene
from starling.sim.scene.builtin import scenes
from starling.sim.sensor.sensor import Sensor
from tests.unit.calibration.small_camera import small

SENSOR = small("d415", 640, 360)
ROWS = 18
ACROSS, DOWN = np.meshgrid(np.linspace(-1, 1, COLUMNS), np.linspace(-1, 1, ROWS))
TRUE_PX = 0.3 * np.cos(4 * np.hypot(ACROSS, 0.6 * DOWN))  # Rings.


def _warped(cells: np.ndarray) -> Sensor:
    warp = tuple(tuple(map(float, row)) for row in cells)
    aligned = replace(SENSOR.right.alignment, warp_px=warp)
    return replace(SENSOR, right=replace(SENSOR.right, alignment=aligned))


def _seen(room: str, distance_m: float, sensor: Sensor) -> Observation:
    scene = scenes.wall(distance_m=distance_m)
    images, _ = heldout.simulate(MitsubaScene(scene), sensor, 1.0)
    info = writer.info_of(SENSOR, source="drawn", licence="Apache-2.0", notes="")
    return Observation(
        name=room,
        room=room,
        info=info,
        left=np.rint(images["left"]),
        right=np.rint(images["right"]),
        scene=scene,
    )


@pytest.fixture(scope="module")
def captured() -> list[Observation]:
    return [_seen(f"{z:g} m", z, _warped(TRUE_PX)) for z in (0.8, 1.2)]


def test_the_warp_is_recovered(captured: list[Observation]) -> None:
    """Cells match, except at the border and in the right band, which only one imager sees."""
    result = fit_warp(captured, SENSOR)
    warp = np.array(result.sensor.right.alignment.warp_px)
    inside = np.s_[1:-1, 1:-3]
    assert np.sqrt(np.mean((warp - TRUE_PX)[inside] ** 2)) < 0.02
    (estimate,) = result.estimates
    assert estimate.value == pytest.approx(np.sqrt(np.mean(warp**2)))
    assert 0 < estimate.sd < 0.05 and estimate.start == 0
    assert any("which imager" in sentence.lower() for sentence in result.undetermined)


def test_a_fit_starts_from_the_sensors_warp(captured: list[Observation]) -> None:
    right = _warped(TRUE_PX)
    result = fit_warp(captured, right)
    moved = np.array(result.sensor.right.alignment.warp_px) - TRUE_PX
    assert np.sqrt(np.mean(moved**2)) < 0.02
    assert result.estimates[0].start == pytest.approx(np.sqrt(np.mean(TRUE_PX**2)))


def test_one_room_is_too_few(captured: list[Observation]) -> None:
    bare = replace(captured[1], right=None)
    with pytest.raises(InputError, match="must hold infrared pairs of 2 rooms for the warp; got 1"):
        fit_warp([captured[0], bare], SENSOR)


def test_differences_belong_to_cells_of_the_right_image() -> None:
    """A difference belongs to the matched cell; matches outside the image are dropped."""
    x = np.broadcast_to(np.arange(64), (36, 64))
    disparity = np.full((36, 64), 4.4, np.float32)
    pixel = np.rint(x - 4.4)
    result = warp_fit._medians((pixel // 2).astype(np.float32), disparity)
    assert result.shape == (18, COLUMNS)
    np.testing.assert_array_equal(result[:, :29], np.broadcast_to(np.arange(29), (18, 29)))
    assert np.isnan(result[:, 30:]).all()
    rows = np.broadcast_to(np.arange(36)[:, None] // 2, (36, 64)).astype(np.float32)
    down = warp_fit._medians(rows, disparity)
    np.testing.assert_array_equal(down[:, 5], np.arange(18))
