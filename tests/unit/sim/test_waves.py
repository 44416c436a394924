"""Waves: a smooth random shift of the image, of each unit its own."""

from __future__ import annotations

import dataclasses
from typing import Any, Literal

import numpy as np
import pytest

from starling.patterns.errors import InputError
from starling.sim.geometry.pinhole import Pinhole
from starling.sim.imaging.imager.charge import Die
from starling.sim.imaging.optics import alignment, waves
from starling.sim.sensor import presets, scaling
from starling.sim.sensor.imager import Alignment

SIZE_PX, ACROSS_DEG, DOWN_DEG = 0.2, 6.0, 12.0
WAVES = Alignment(waves_px=SIZE_PX, waves_across_deg=ACROSS_DEG, waves_down_deg=DOWN_DEG)
PINHOLE = Pinhole(width=400, height=300, fx_px=260, fy_px=250, cx_px=190.0, cy_px=160.0)


def drawn(unit: int, side: Literal["left", "right"] = "right") -> np.ndarray:
    return waves.field(WAVES, PINHOLE, Die(unit, side))


def test_units_and_imagers_have_their_own_waves() -> None:
    first = drawn(0)
    assert np.array_equal(first, drawn(0))
    for second in (drawn(1), drawn(0, "left")):
        assert abs(np.corrcoef(first.ravel(), second.ravel())[0, 1]) < 0.6
    assert not waves.field(Alignment(), PINHOLE, Die(0, "right")).any()


@pytest.mark.parametrize("unit", [0, 1, 5])
def test_size_is_that_asked_for_in_the_view_of_a_d415(unit: int) -> None:
    whole = Pinhole(width=1280, height=720, fx_px=900, fy_px=900, cx_px=639.5, cy_px=359.5)
    shift = waves.field(WAVES, whole, Die(unit, "right"))
    assert shift.std() == pytest.approx(SIZE_PX, rel=0.05)
    assert abs(shift.mean()) < 0.1 * SIZE_PX


@pytest.mark.parametrize("unit", range(6))
def test_disparity_errors_of_all_units_are_equally_large(unit: int) -> None:
    whole = Pinhole(width=1280, height=720, fx_px=900, fy_px=900, cx_px=639.5, cy_px=359.5)
    left, right = (waves.field(WAVES, whole, Die(unit, side)) for side in ("left", "right"))
    assert (left - right).std() == pytest.approx(np.sqrt(2) * SIZE_PX, rel=0.05)


@pytest.mark.slow
def test_lengths_are_those_asked_for() -> None:
    """Rationale: normal noise of known covariance.

    Expected behaviour: over many units the correlation of two pixels falls to 1/e over the length
    along each axis, measured as an angle. Each unit's mean is removed, which lowers it a little.
    """
    fields = np.stack([drawn(unit) for unit in range(300)])
    middle = fields[:, 160, 190]
    right = fields[:, 160, 190 + round(np.tan(np.radians(ACROSS_DEG)) * PINHOLE.fx_px)]
    below = fields[:, 160 - round(np.tan(np.radians(DOWN_DEG)) * PINHOLE.fy_px), 190]
    for place in (right, below):
        assert np.corrcoef(middle, place)[0, 1] == pytest.approx(np.exp(-1), abs=0.15)


def test_all_modes_show_one_field() -> None:
    sensor = presets.load("d435")
    sensor = dataclasses.replace(sensor, right=dataclasses.replace(sensor.right, alignment=WAVES))

    def shift(seen) -> np.ndarray:
        return waves.field(seen.right.alignment, Pinhole.from_camera(seen), Die(0, "right"))

    whole, part = shift(sensor), shift(scaling.scaled(sensor, 1.0, 424, 240))
    np.testing.assert_allclose(part, whole[120:360, 212:636], atol=1e-6)
    half = shift(scaling.scaled(sensor, 0.5, 424, 240))
    pixels = whole.reshape(240, 2, 424, 2).mean((1, 3))
    np.testing.assert_allclose(half, pixels / 2, atol=1e-3)


def test_waves_shift_the_image_to_the_right() -> None:
    ramp = np.tile(np.arange(PINHOLE.width, dtype=np.float32), (PINHOLE.height, 1))
    die = Die(3, "right")
    (moved,) = alignment.misalign((ramp,), WAVES, PINHOLE, die)
    inner = slice(5, -5)
    np.testing.assert_allclose(
        (ramp - moved)[:, inner], waves.field(WAVES, PINHOLE, die)[:, inner], atol=1e-3
    )


def test_lengths_without_waves_leave_images_as_they_are() -> None:
    parts = (np.ones((300, 400), np.float32),)
    lengths = Alignment(waves_across_deg=3.0, waves_down_deg=4.0)
    assert alignment.misalign(parts, lengths, PINHOLE, Die(0, "left")) is parts


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"waves_px": -0.1}, r"alignment.waves_px must be in \[0, 5\]; got -0.1"),
        ({"waves_across_deg": 0.5}, r"alignment.waves_across_deg must be in \[1, 180\]; got 0.5"),
        ({"waves_down_deg": 190.0}, r"alignment.waves_down_deg must be in \[1, 180\]; got 190"),
    ],
)
def test_impossible_waves_are_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Alignment(**changes)
