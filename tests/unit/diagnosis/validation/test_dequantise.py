"""Dequantisation removes quantisation noise only."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from starling.diagnosis.validation.camera.dequantise import dequantise, subcode_offsets

SHAPE = (200, 320)


def scene(sigma_px: float) -> np.ndarray:
    """A brightness slope with noise of 3 DN before averaging."""
    rng = np.random.default_rng(0)
    slope = np.linspace(20, 80, SHAPE[1])[None, :]
    return slope + ndimage.gaussian_filter(rng.normal(0, 3, SHAPE), sigma_px)


@pytest.mark.parametrize("sigma_px", [0.0, 0.7, 1.0])
def test_the_result_rounds_to_the_codes(sigma_px: float):
    codes = np.rint(scene(sigma_px)).astype(np.uint8)
    np.testing.assert_array_equal(np.rint(dequantise(codes)), codes)


def test_quantisation_noise_is_removed_at_the_finest_scale():
    """An averaged image has no power at the finest scale. Its codes have 1/12 DN^2."""
    image = scene(1.0)
    codes = np.rint(image).astype(np.uint8)
    result = dequantise(codes)
    power = [_finest(values) for values in (image, codes.astype(float), result)]
    assert power[0] < 0.005 < 1 / 15 < power[1]
    assert power[2] < 0.01
    assert (result - image).std() < 0.9 * (codes - image).std()


def test_structure_far_above_quantisation_noise_is_preserved():
    image = scene(0.0)
    result = dequantise(np.rint(image).astype(np.uint8))
    assert result.std() == pytest.approx(image.std(), rel=0.002)
    assert _finest(result) == pytest.approx(_finest(image), rel=0.02)


@pytest.mark.parametrize("sigma_px", [0.7, 1.0])
def test_offsets_make_the_share_of_crossing_pixels_linear(sigma_px: float):
    """Law: a shift by a fraction of a code moves that fraction of pixels to the next code."""
    level = dequantise(np.rint(scene(sigma_px)).astype(np.uint8))
    offset_level = level + subcode_offsets(SHAPE, side="left")
    for shift in (0.1, 0.3, 0.5, 0.8):
        crossed = np.rint(offset_level + shift) > np.rint(offset_level)
        assert crossed.mean() == pytest.approx(shift, abs=0.06)
    crossed = np.rint(level + 0.1) > np.rint(level)
    assert crossed.mean() < 0.04  # Without offsets few pixels are near a rounding edge.


def test_offsets_are_smooth_and_differ_between_imagers():
    left, right = (subcode_offsets((400, 600), side=side) for side in ("left", "right"))
    assert np.abs(left).max() <= 0.5
    np.testing.assert_allclose(np.quantile(left, [0.25, 0.5, 0.75]), [-0.25, 0, 0.25], atol=0.06)
    assert np.abs(np.diff(left, axis=1)).max() < 0.1
    assert abs(np.corrcoef(left.ravel(), right.ravel())[0, 1]) < 0.15
    np.testing.assert_array_equal(left, subcode_offsets((400, 600), side="left"))


def _finest(image: np.ndarray) -> float:
    """Return the mean power of the highest frequencies, as variance per pixel of white noise."""
    power = np.abs(np.fft.fft2(image - image.mean())) ** 2 / image.size
    down, across = (np.abs(np.fft.fftfreq(side)) for side in image.shape)
    return float(power[np.hypot(down[:, None], across[None, :]) > 0.55].mean())
