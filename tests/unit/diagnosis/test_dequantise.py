"""Dequantised levels: near their codes, without quantisation noise, and with the same texture."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from starling.diagnosis.transfer.dequantise import draw_levels

SHAPE = (210, 330)


def finest(image: np.ndarray) -> float:
    """Return the variance of white noise with the power at the highest frequencies."""
    power = np.abs(np.fft.fft2(image - image.mean())) ** 2 / image.size
    down, across = (np.abs(np.fft.fftfreq(side)) for side in image.shape)
    return float(power[np.ix_(down > 0.4, across > 0.4)].mean())


def blurred(image: np.ndarray, sigma_px: float) -> np.ndarray:
    return cv2.GaussianBlur(image.astype(np.float32), (0, 0), sigma_px)


def averaged(spread_dn: float, sigma_px: float) -> np.ndarray:
    """Smooth noise on a ramp."""
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
def test_levels_are_near_their_codes(seed: int, spread_dn: float, rows: int, columns: int):
    """They differ by quantisation noise and by shares of a code."""
    noise = np.random.default_rng(seed).normal(0, spread_dn, (rows, columns))
    codes = np.clip(np.rint(100 + noise), 0, 255).astype(np.uint8)
    levels = draw_levels(codes)
    assert levels.dtype == np.float32
    assert np.abs(levels - codes).max() < 3
    np.testing.assert_array_equal(levels, draw_levels(codes))


def test_quantisation_noise_is_removed_from_smooth_images():
    image = averaged(3.0, 1.0)
    codes = np.rint(image).astype(np.uint8)
    levels = draw_levels(codes)
    assert finest(image) < 0.005 < 1 / 15 < finest(codes.astype(float))
    assert finest(levels) < 0.01


def test_strong_texture_is_kept():
    image = averaged(3.0, 0.01)
    levels = draw_levels(np.rint(image).astype(np.uint8))
    assert finest(levels) == pytest.approx(finest(image), rel=0.03)


def test_weak_noise_keeps_its_power():
    """A draw has the codes' power less quantisation noise; the most likely levels have less."""
    rng = np.random.default_rng(3)
    codes = np.rint(averaged(0.0, 1.0) + rng.normal(0, 0.32, SHAPE)).astype(np.uint8)
    expected = finest(codes.astype(float)) - 1 / 12 - 0.02
    assert finest(draw_levels(codes)) == pytest.approx(expected, rel=0.06)


def test_uniform_areas_are_shifted_evenly_and_differently_in_each_image():
    """Law: a shift by a share of a DN changes the code of that share of the pixels."""
    codes = np.kron(np.array([[7, 8], [9, 30]], np.uint8), np.ones((300, 400), np.uint8))
    second = codes.copy()
    second[0, 0] += 1
    left, right = draw_levels(codes), draw_levels(second)
    for shift in (0.1, 0.3, 0.5, 0.8):
        changed = np.rint(left + shift) > np.rint(left)
        assert changed.mean() == pytest.approx(shift, abs=0.06)
    # The shift alone rounds to the same code.
    assert np.abs(left - codes)[100:200, 100:300].max() < 0.55
    assert abs((left - codes).mean()) < 0.05
    assert np.abs(np.diff(left[100:200, 100:300], axis=1)).max() < 0.2
    assert abs(np.corrcoef((left - codes).ravel(), (right - codes).ravel())[0, 1]) < 0.15


@pytest.mark.parametrize("dots_dn", [0.0, 20.0])
@pytest.mark.parametrize("spread_dn", [0.3, 0.6])
def test_rounded_levels_respond_to_blur_as_the_original(dots_dn: float, spread_dn: float):
    """Between dots: whole codes hardly respond, because a slight blur rounds to the same codes."""
    rng = np.random.default_rng(1)
    dots = blurred(rng.random(SHAPE) < 0.012, 1.1)
    dots *= dots_dn / dots.max()
    noise = blurred(rng.normal(size=SHAPE), 0.7)
    image = np.linspace(6, 12, SHAPE[1]) + dots + spread_dn * noise / noise.std()
    between = cv2.dilate(dots, np.ones((3, 3))) < 0.3
    codes = np.rint(image).astype(np.uint8)

    def kept_power(levels: np.ndarray) -> float:
        after, before = (
            np.square(cv2.Laplacian(np.rint(each).astype(np.float32), cv2.CV_32F))[between].mean()
            for each in (blurred(levels, 0.5), levels)
        )
        return float(after / before)

    expected = kept_power(image)
    assert kept_power(codes) > expected + 0.25
    error = abs(kept_power(draw_levels(codes)) - expected)
    assert error < 0.3 * (kept_power(codes) - expected)
