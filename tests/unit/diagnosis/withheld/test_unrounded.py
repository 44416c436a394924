"""What rounding put into an image is taken out, and nothing else."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from diagnosis.withheld.unrounded import unrounded

SHAPE = (200, 320)


def scene(sigma_px: float) -> np.ndarray:
    """Noise of 3 DN before averaging, on a slope."""
    rng = np.random.default_rng(0)
    slope = np.linspace(20, 80, SHAPE[1])[None, :]
    return slope + ndimage.gaussian_filter(rng.normal(0, 3, SHAPE), sigma_px)


@pytest.mark.parametrize("sigma_px", [0.0, 0.7, 1.0])
def test_it_rounds_to_the_codes_it_was_made_of(sigma_px: float):
    codes = np.rint(scene(sigma_px)).astype(np.uint8)
    np.testing.assert_array_equal(np.rint(unrounded(codes, side="left")), codes)


def test_power_of_rounding_is_gone_where_it_is_all_there_is():
    """An averaged image holds nothing at the finest scale; its codes 1/12 DN^2."""
    image = scene(1.0)
    codes = np.rint(image).astype(np.uint8)
    made = unrounded(codes, side="left")
    power = [_finest(one) for one in (image, codes.astype(float), made)]
    assert power[0] < 0.005 < 1 / 15 < power[1]
    assert power[2] < 0.01
    assert (made - image).std() < 0.9 * (codes - image).std()


def test_what_is_far_above_rounding_stays():
    image = scene(0.0)
    made = unrounded(np.rint(image).astype(np.uint8), side="left")
    assert made.std() == pytest.approx(image.std(), rel=0.002)
    assert _finest(made) == pytest.approx(_finest(image), rel=0.02)


def test_even_places_lie_anywhere_within_their_codes():
    """Moved by a share of a code that share of them has another, whatever the share."""
    codes = np.kron(np.array([[7, 8], [9, 30]], np.uint8), np.ones((300, 400), np.uint8))
    level = unrounded(codes, side="left")
    np.testing.assert_array_equal(np.rint(level), codes)
    for moved in (0.1, 0.3, 0.5, 0.8):
        assert (np.rint(level + moved) > codes).mean() == pytest.approx(moved, abs=0.06)
    assert np.abs(np.diff(level[100:200, 100:300], axis=1)).max() < 0.2
    other = unrounded(codes, side="right")
    assert abs(np.corrcoef((level - codes).ravel(), (other - codes).ravel())[0, 1]) < 0.15


def _finest(image: np.ndarray) -> float:
    """Variance per pixel that white noise of the finest structures' power would have."""
    power = np.abs(np.fft.fft2(image - image.mean())) ** 2 / image.size
    down, across = (np.abs(np.fft.fftfreq(side)) for side in image.shape)
    return float(power[np.hypot(down[:, None], across[None, :]) > 0.55].mean())
