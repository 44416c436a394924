"""Unmixing of brightness that a Gaussian mixed across depth edges."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from starling.sim.scene.captured.captured_scene import unmix_edges

SHAPE = (96, 160)
SIGMA_PX = 12.0


def _smoothed(image: np.ndarray) -> np.ndarray:
    return np.asarray(cv2.GaussianBlur(image, (0, 0), SIGMA_PX), np.float32)


def _strip(dark: float, bright: float) -> tuple[np.ndarray, np.ndarray]:
    """A dark far strip of 40 px between two bright near walls."""
    brightness = np.full(SHAPE, bright, np.float32)
    disparity = np.full(SHAPE, 30, np.float32)
    brightness[:, 60:100], disparity[:, 60:100] = dark, 12
    return brightness, disparity


@pytest.mark.parametrize(("dark", "bright"), [(0.05, 0.5), (0.5, 0.05), (0.0, 1.0)])
def test_strip_between_walls_recovers_its_brightness(dark: float, bright: float) -> None:
    """The error is at most 3 % of the step; in the smoothed image it is 50 % at the edge."""
    brightness, disparity = _strip(dark, bright)
    mixed = _smoothed(brightness)
    step = abs(bright - dark)
    assert np.abs(mixed - brightness).max() > 0.45 * step
    assert np.abs(unmix_edges(mixed, disparity, SIGMA_PX) - brightness).max() < 0.03 * step


def test_detail_within_a_surface_stays_lost() -> None:
    """Without a depth edge the blur remains: no detail is restored."""
    brightness, _ = _strip(0.05, 0.5)
    mixed = _smoothed(brightness)
    unmixed = unmix_edges(mixed, np.full(SHAPE, 30, np.float32), SIGMA_PX)
    steepest = [np.abs(np.diff(image, axis=1)).max() for image in (brightness, mixed, unmixed)]
    assert steepest[2] < 2.5 * steepest[1] < 0.2 * steepest[0]


@settings(max_examples=20)
@given(st.integers(0, 2**32 - 1), st.floats(1e-3, 1e3))
def test_smoothing_the_result_restores_the_image_in_any_unit(seed: int, unit: float) -> None:
    rng = np.random.default_rng(seed)
    brightness = np.kron(rng.uniform(0.05, 1, (3, 4)), np.ones((32, 40))).astype(np.float32)
    apart = rng.permutation(np.linspace(5, 60, 12)).reshape(
        3, 4
    )  # Each region is a separate surface.
    disparity = np.kron(apart, np.ones((32, 40))).astype(np.float32)
    disparity[rng.random(SHAPE) < 0.02] = np.nan
    mixed = _smoothed(brightness)
    unmixed = unmix_edges(mixed, disparity, SIGMA_PX)
    assert unmixed.dtype == np.float32
    assert (unmixed >= 0).all()
    assert np.abs(_smoothed(unmixed) / mixed - 1).mean() < 0.03
    scaled = unmix_edges(mixed * np.float32(unit), disparity, SIGMA_PX)
    np.testing.assert_allclose(scaled / unit, unmixed, rtol=2e-3, atol=1e-4)


def test_uniform_image_is_unchanged_even_if_dark() -> None:
    _, disparity = _strip(0, 1)
    for value in (0.0, 0.3):
        image = np.full(SHAPE, value, np.float32)
        np.testing.assert_allclose(unmix_edges(image, disparity, SIGMA_PX), image, rtol=1e-4)
