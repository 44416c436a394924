"""The smooth fixed pattern: its law, its device, and its place in the chain."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from starling.patterns.errors import InputError
from starling.sim.imaging import imager
from starling.sim.imaging.imager import charge
from starling.sim.imaging.imager.charge import Die
from starling.sim.sensor import presets, scaling
from starling.sim.sensor.sensor import Imager

PART = Imager(pattern_contrast=0.05)
SHAPE = (400, 500)


def field(part: Imager = PART, die: Die = Die(3, "left"), shape: tuple[int, int] = SHAPE):  # noqa: B008
    return charge.smooth_sensitivity(part, die, shape).astype(float) - 1


@pytest.mark.parametrize("length_px", [2.0, 8.0, 20.0])
def test_contrast_and_correlation_are_those_set(length_px: float) -> None:
    """Over devices: standard deviation to 3 %, and correlation 1/e at the length."""
    part = dataclasses.replace(PART, pattern_px=length_px)
    fields = np.stack([field(part, Die(unit, "left")) for unit in range(8)])
    assert fields.std() == pytest.approx(0.05, rel=0.03)
    assert abs(fields.mean()) < 0.003
    apart = int(length_px)
    for shifted, rest in (
        (fields[:, apart:], fields[:, :-apart]),
        (fields[:, :, apart:], fields[:, :, :-apart]),
    ):
        assert (shifted * rest).mean() / fields.var() == pytest.approx(np.exp(-1), abs=0.04)


def test_each_imager_of_each_device_has_its_own() -> None:
    first = field()
    assert np.array_equal(first, field())
    for die in (Die(3, "right"), Die(4, "left")):
        assert abs(np.corrcoef(first.ravel(), field(die=die).ravel())[0, 1]) < 0.15


def test_borders_have_the_contrast_of_the_middle() -> None:
    fields = np.stack([field(die=Die(unit, "left"), shape=(30, 40)) for unit in range(300)])
    deviation = fields.std(axis=0)
    assert deviation[0].mean() == pytest.approx(deviation[15].mean(), rel=0.1)


def test_the_image_is_multiplied_and_nothing_else_moves() -> None:
    """It follows crosstalk and multiplies PRNU; it is static."""
    light = np.full(SHAPE, 4000.0, np.float32)
    part = dataclasses.replace(PART, prnu=0.02, dark_current_e_s=100.0)
    die = Die(3, "left")
    plain = dataclasses.replace(part, pattern_contrast=0.0)
    dark = np.float32(1.0)
    expected = (charge.collect(plain, light, 0.01, die) - dark) * (1 + field()) + dark
    seen = charge.collect(part, light, 0.01, die)
    np.testing.assert_allclose(seen, expected, rtol=1e-5)
    both = charge.sensitivity(part, die, SHAPE) * light + dark
    np.testing.assert_allclose(seen, both, rtol=1e-5)
    alone = charge.sensitivity(PART, die, SHAPE)
    assert np.array_equal(alone, charge.smooth_sensitivity(PART, die, SHAPE))


def test_strong_patterns_are_never_negative() -> None:
    part = dataclasses.replace(PART, pattern_contrast=0.5)
    assert charge.smooth_sensitivity(part, Die(3, "left"), SHAPE).min() == 0


def test_frames_share_it() -> None:
    light = np.full((60, 80), 4000.0, np.float32)

    def read(frame: int) -> np.ndarray:
        taken = imager.read_out(
            PART, light, exposure_s=0.01, unit=3, side="left", seed=frame, frame=frame
        )
        return taken.delivered

    assert np.array_equal(read(0), read(1)) and np.ptp(read(0)) > 0


def test_a_mode_shows_the_pattern_in_its_pixels() -> None:
    sensor = presets.load("d435")
    half = scaling.scaled(sensor, 0.5, sensor.width // 2, sensor.height // 2)
    assert half.left.pattern_px == sensor.left.pattern_px / 2


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"pattern_contrast": 0.6}, r"^imager.pattern_contrast must be in \[0, 0.5\]; got 0.6"),
        ({"pattern_contrast": -0.1}, r"^imager.pattern_contrast must be in \[0, 0.5\]"),
        ({"pattern_px": 0.0}, r"^imager.pattern_px must be in \[0.1, 500\]; got 0.0"),
    ],
)
def test_impossible_patterns_are_refused(change: dict[str, float], message: str) -> None:
    with pytest.raises(InputError, match=message):
        dataclasses.replace(PART, **change)
