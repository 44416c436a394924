"""What rounding put into an image is taken out, and nothing else."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from starling.diagnosis.validation.camera.unrounded import shares, unrounded

SHAPE = (200, 320)


def scene(sigma_px: float) -> np.ndarray:
    """Noise of 3 DN before averaging, on a slope."""
    rng = np.random.default_rng(0)
    slope = np.linspace(20, 80, SHAPE[1])[None, :]
    return slope + ndimage.gaussian_filter(rng.normal(0, 3, SHAPE), sigma_px)


@pytest.mark.parametrize("sigma_px", [0.0, 0.7, 1.0])
def test_it_rounds_to_the_codes_it_was_made_of(sigma_px: float):
    codes = np.rint(scene(sigma_px)).astype(np.uint8)
    np.testing.assert_array_equal(np.rint(unrounded(codes)), codes)


def test_power_of_rounding_is_gone_where_it_is_all_there_is():
    """An averaged image holds nothing at the finest scale; its codes 1/12 DN^2."""
    image = scene(1.0)
    codes = np.rint(image).astype(np.uint8)
    made = unrounded(codes)
    power = [_finest(one) for one in (image, codes.astype(float), made)]
    assert power[0] < 0.005 < 1 / 15 < power[1]
    assert power[2] < 0.01
    assert (made - image).std() < 0.9 * (codes - image).std()


def test_what_is_far_above_rounding_stays():
    image = scene(0.0)
    made = unrounded(np.rint(image).astype(np.uint8))
    assert made.std() == pytest.approx(image.std(), rel=0.002)
    assert _finest(made) == pytest.approx(_finest(image), rel=0.02)


@pytest.mark.parametrize("sigma_px", [0.7, 1.0])
def test_with_its_share_of_a_code_an_image_lies_anywhere_within(sigma_px: float):
    """Law: what is moved by a part of a code is that part over to the next, whatever the part."""
    level = unrounded(np.rint(scene(sigma_px)).astype(np.uint8))
    moved = [0.1, 0.3, 0.5, 0.8]
    by_share = level + shares(SHAPE, side="left")
    for part in moved:
        over = np.rint(by_share + part) > np.rint(by_share)
        assert over.mean() == pytest.approx(part, abs=0.06)
    assert (np.rint(level + 0.1) > np.rint(level)).mean() < 0.04  # Without, few are near an edge.


def test_shares_are_smooth_and_each_imager_has_its_own():
    left, right = (shares((400, 600), side=side) for side in ("left", "right"))
    assert np.abs(left).max() <= 0.5
    np.testing.assert_allclose(np.quantile(left, [0.25, 0.5, 0.75]), [-0.25, 0, 0.25], atol=0.06)
    assert np.abs(np.diff(left, axis=1)).max() < 0.1
    assert abs(np.corrcoef(left.ravel(), right.ravel())[0, 1]) < 0.15
    np.testing.assert_array_equal(left, shares((400, 600), side="left"))


def _finest(image: np.ndarray) -> float:
    """Variance per pixel that white noise of the finest structures' power would have."""
    power = np.abs(np.fft.fft2(image - image.mean())) ** 2 / image.size
    down, across = (np.abs(np.fft.fftfreq(side)) for side in image.shape)
    return float(power[np.hypot(down[:, None], across[None, :]) > 0.55].mean())
