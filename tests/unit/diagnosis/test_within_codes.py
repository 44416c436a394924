"""Levels are those of their codes, but lack what rounding added, and answer as these did."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from starling.diagnosis.transfer.dequantise import levels

SHAPE = (210, 330)


def finest(image: np.ndarray) -> float:
    """Variance per pixel that white noise of the finest structures' power would have."""
    power = np.abs(np.fft.fft2(image - image.mean())) ** 2 / image.size
    down, across = (np.abs(np.fft.fftfreq(side)) for side in image.shape)
    return float(power[np.ix_(down > 0.4, across > 0.4)].mean())


def blurred(image: np.ndarray, sigma_px: float) -> np.ndarray:
    return cv2.GaussianBlur(image.astype(np.float32), (0, 0), sigma_px)


def averaged(spread_dn: float, sigma_px: float) -> np.ndarray:
    """Noise on a slope, averaged."""
    noise = np.random.default_rng(0).normal(0, spread_dn, SHAPE)
    slope = np.linspace(20, 80, SHAPE[1])[None, :]
    return cv2.GaussianBlur(noise, (0, 0), sigma_px) + slope


@settings(max_examples=20, deadline=None)
@given(
    seed=st.integers(0, 1000),
    spread_dn=st.floats(0, 60),
    rows=st.integers(17, 70),
    columns=st.integers(17, 70),
)
def test_levels_are_about_their_codes(seed: int, spread_dn: float, rows: int, columns: int):
    """Off by rounding's noise, and by shares of a code."""
    noise = np.random.default_rng(seed).normal(0, spread_dn, (rows, columns))
    codes = np.clip(np.rint(100 + noise), 0, 255).astype(np.uint8)
    found = levels(codes)
    assert found.dtype == np.float32
    assert np.abs(found - codes).max() < 3
    np.testing.assert_array_equal(found, levels(codes))


def test_power_of_rounding_is_gone_where_it_is_all_there_is():
    image = averaged(3.0, 1.0)
    codes = np.rint(image).astype(np.uint8)
    found = levels(codes)
    assert finest(image) < 0.005 < 1 / 15 < finest(codes.astype(float))
    assert finest(found) < 0.01


def test_what_is_far_above_rounding_stays():
    image = averaged(3.0, 0.01)
    found = levels(np.rint(image).astype(np.uint8))
    assert finest(found) == pytest.approx(finest(image), rel=0.03)


def test_noise_as_loud_as_rounding_keeps_its_power():
    """What is drawn has the codes' power less that of rounding and of what is taken for dots',
    not the lesser power of what is likeliest."""
    rng = np.random.default_rng(3)
    codes = np.rint(averaged(0.0, 1.0) + rng.normal(0, 0.32, SHAPE)).astype(np.uint8)
    wanted = finest(codes.astype(float)) - 1 / 12 - 0.02
    assert finest(levels(codes)) == pytest.approx(wanted, rel=0.06)


def test_even_places_lie_anywhere_within_their_codes_and_otherwise_in_each_image():
    """Law: moved by a share of a code, that share of them has another."""
    codes = np.kron(np.array([[7, 8], [9, 30]], np.uint8), np.ones((300, 400), np.uint8))
    other = codes.copy()
    other[0, 0] += 1
    left, right = levels(codes), levels(other)
    for moved in (0.1, 0.3, 0.5, 0.8):
        changed = np.rint(left + moved) > np.rint(left)
        assert changed.mean() == pytest.approx(moved, abs=0.06)
    # And by no more than what rounds to the code again.
    assert np.abs(left - codes)[100:200, 100:300].max() < 0.55
    assert abs((left - codes).mean()) < 0.05
    assert np.abs(np.diff(left[100:200, 100:300], axis=1)).max() < 0.2
    assert abs(np.corrcoef((left - codes).ravel(), (right - codes).ravel())[0, 1]) < 0.15


@pytest.mark.parametrize("dots_dn", [0.0, 20.0])
@pytest.mark.parametrize("spread_dn", [0.3, 0.6])
def test_rounded_anew_they_answer_to_blur_as_what_was_rounded(dots_dn: float, spread_dn: float):
    """Between dots, where codes themselves hardly answer: blurred by little they round to these."""
    rng = np.random.default_rng(1)
    dots = blurred(rng.random(SHAPE) < 0.012, 1.1)
    dots *= dots_dn / dots.max()
    noise = blurred(rng.normal(size=SHAPE), 0.7)
    image = np.linspace(6, 12, SHAPE[1]) + dots + spread_dn * noise / noise.std()
    between = cv2.dilate(dots, np.ones((3, 3))) < 0.3
    codes = np.rint(image).astype(np.uint8)

    def left(one: np.ndarray) -> float:
        fine, before = (
            np.square(cv2.Laplacian(np.rint(each).astype(np.float32), cv2.CV_32F))[between].mean()
            for each in (blurred(one, 0.5), one)
        )
        return float(fine / before)

    wanted = left(image)
    assert left(codes) > wanted + 0.25
    assert abs(left(levels(codes)) - wanted) < 0.3 * (left(codes) - wanted)
