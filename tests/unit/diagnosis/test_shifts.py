"""Readings of displacement over the whole range of the effects that displace an image."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from starling.diagnosis.features import shifts
from starling.diagnosis.scenes.strata import Strata, stratify
from starling.sim.effects import named
from tests.unit.diagnosis.test_features import BODY, DISPARITY, HEIGHT, INFO, TANGENTS, WIDTH

MOST_PX = shifts.REACH_PX - 0.6  # Of both components.
DOT_PX = (0.6, 1.0, 1.6)  # Sigma of a dot: small images, sharp lenses, a D435.
ROUNDING_PX = 1e-6


def dots(sigma_px: float, right_px: float = 0.0, down_px: float = 0.0) -> NDArray[np.float32]:
    """Draw dots at exact places, so that a displacement needs no interpolation."""
    rng = np.random.default_rng(7)
    spacing = 3.5 * sigma_px
    count = int((HEIGHT + 20) * (WIDTH + 20) / spacing**2)
    places = rng.uniform((-10, -10), (HEIGHT + 10, WIDTH + 10), size=(count, 2))
    y, x = np.indices((HEIGHT, WIDTH))
    across = np.exp(-((x[0] - places[:, 1:] - right_px) ** 2) / (2 * sigma_px**2))
    along = np.exp(-((y[:, 0] - places[:, :1] - down_px) ** 2) / (2 * sigma_px**2))
    return (20 + 60 * along.T @ across).astype(np.float32)


GROUNDS = {
    sigma: stratify(DISPARITY, dots(sigma), INFO, body=BODY, projector=TANGENTS) for sigma in DOT_PX
}


def read(ground: Strata, image: NDArray[np.float32]) -> tuple[float, float]:
    features = shifts.dot_shift_features(image, ground)
    return -features["dots.shift x.all"], -features["dots.shift y.all"]


@settings(max_examples=25)
@given(st.sampled_from(DOT_PX), st.floats(-MOST_PX, MOST_PX), st.floats(-MOST_PX, MOST_PX))
def test_a_shift_is_read_in_pixels_over_the_whole_range(sigma: float, right: float, down: float):
    read_right, read_down = read(GROUNDS[sigma], dots(sigma, right, down))
    assert read_right == pytest.approx(right, abs=shifts.TOLERANCE_PX)
    assert read_down == pytest.approx(down, abs=shifts.TOLERANCE_PX)


@pytest.mark.parametrize("sigma", DOT_PX)
def test_readings_rise_with_the_shift(sigma: float):
    values = np.linspace(-MOST_PX, MOST_PX, 15)
    readings = [read(GROUNDS[sigma], dots(sigma, value, value)) for value in values]
    assert (np.diff(readings, axis=0) > 0).all()


def test_the_range_covers_the_effects_that_displace_one_imager():
    for name in ("vertical_offset", "disparity_offset", "distortion"):
        parameter = named(name).parameters[0]
        assert parameter.low is not None and parameter.high is not None
        assert max(-parameter.low, parameter.high) <= MOST_PX


@pytest.mark.parametrize("shift_px", [4.6, 9.0])
def test_a_larger_shift_has_no_reading(shift_px: float):
    """At 4.6 px the flank of the peak is seen, at 9 px nothing of it."""
    features = shifts.dot_shift_features(dots(1.0, shift_px), GROUNDS[1.0])
    assert "dots.shift x.all" not in features
    assert (features["dots.match.all"] < 0.5) == (shift_px > 2 * shifts.REACH_PX)


def test_height_and_width_of_the_peak_do_not_depend_on_the_fraction_of_a_pixel():
    whole, between = (
        shifts.dot_shift_features(dots(0.6, value), GROUNDS[0.6]) for value in (0.0, 0.5)
    )
    for name in ("dots.match.all", "dots.width x.all", "dots.width y.all"):
        assert between[name] == pytest.approx(whole[name], abs=0.2)


@pytest.mark.parametrize(("right", "down"), [(1.4, 0.0), (0.0, -1.5), (-2.6, 1.2)])
def test_a_pair_is_read_through_the_reference_disparity(right: float, down: float):
    left = dots(1.0)
    ground = stratify(np.full_like(DISPARITY, 6), left, INFO, body=BODY, projector=TANGENTS)
    features = shifts.pair_shift_features(left, dots(1.0, right - 6, down), ground)
    assert features["pair.shift x.all"] == pytest.approx(right, abs=shifts.TOLERANCE_PX)
    assert features["pair.shift y.all"] == pytest.approx(down, abs=shifts.TOLERANCE_PX)


def test_a_flat_image_has_no_shift_but_a_match_of_zero():
    features = shifts.dot_shift_features(np.full_like(DISPARITY, 40), GROUNDS[1.0])
    assert features["dots.match.all"] == pytest.approx(0.0, abs=ROUNDING_PX)
    assert not [name for name in features if "shift" in name or "width" in name]
