"""Codes: gain, full well, bits, black level, tone curve and smoothing follow the effect pages."""

from __future__ import annotations

import numpy as np
import pytest

from starling.diagnosis.validation.camera import readout
from starling.diagnosis.validation.camera.catalogue import Strengths
from starling.diagnosis.validation.camera.nominal import Nominal


def _codes(camera: Nominal, charge_e: np.ndarray | float, **values: float) -> np.ndarray:
    strengths = Strengths(nominal=camera, values=values)
    return readout.codes(np.full((20, 30), charge_e), strengths)


def test_gain_well_and_bits_scale_the_conversion(camera: Nominal) -> None:
    """Law: DN = gain * electrons * ceiling / full well + black level."""
    assert _codes(camera, 1000.0)[0, 0] == pytest.approx(25.5 + 4.0)
    assert _codes(camera, 1000.0, gain=3.0)[0, 0] == pytest.approx(76.5 + 4.0)
    assert _codes(camera, 1000.0, saturation=5000.0)[0, 0] == pytest.approx(51.0 + 4.0)
    assert _codes(camera, 1000.0, quantisation=10.0)[0, 0] == pytest.approx(102.3 + 4.0)
    assert _codes(camera, 1000.0, black_level=9.0)[0, 0] == pytest.approx(25.5 + 9.0)


def test_codes_stay_in_their_range(camera: Nominal) -> None:
    assert _codes(camera, 1e6).max() == 255.0
    assert _codes(camera, -1e6).min() == 0.0
    assert _codes(camera, 1e6, quantisation=10.0).max() == 1023.0


@pytest.mark.parametrize("gamma", [0.8, 1.3, 2.2])
def test_tone_curve_is_the_power_law(gamma: float) -> None:
    signal = np.linspace(0.0, 255.0, 300)
    law = 255.0 * (signal / 255.0) ** (1.0 / gamma)
    assert np.abs(readout.tone(signal, gamma, 255.0) - law).max() < 0.6
    assert readout.tone(np.array([-5.0]), gamma, 255.0)[0] == 0.0


def test_tone_curve_comes_before_the_black_level(camera: Nominal) -> None:
    assert _codes(camera, 0.0, gamma=2.2)[0, 0] == pytest.approx(4.0)
    assert _codes(camera, 2500.0, gamma=2.0)[0, 0] == pytest.approx(255 * 0.5 + 4.0, abs=0.3)


@pytest.mark.parametrize("sigma_px", [0.5, 1.0])
def test_smoothing_averages_noise(sigma_px: float) -> None:
    """Law: the noise variance scales by 1 / (4 pi sigma^2) in the limit of wide kernels.

    At 0.5 px the discrete kernel preserves 10 % more.
    """
    noise = np.random.default_rng(0).normal(100.0, 20.0, (200, 300))
    out = readout.smooth(noise, sigma_px)
    ratio = out.var() / noise.var()
    assert ratio == pytest.approx(1.0 / (4 * np.pi * sigma_px**2), rel=0.13)
    correlation = np.corrcoef(out[:, 1:].ravel(), out[:, :-1].ravel())[0, 1]
    assert correlation == pytest.approx(np.exp(-1 / (4 * sigma_px**2)), abs=0.08)
    assert readout.smooth(noise, 0.0) is noise


def test_codes_are_rounded_and_clipped() -> None:
    out = readout.round_codes(np.array([-3.0, 1.4, 1.6, 300.0]), 8)
    assert out.dtype == np.uint8
    assert out.tolist() == [0, 1, 2, 255]
    assert readout.round_codes(np.array([2000.0]), 10).tolist() == [1023]
    assert readout.round_codes(np.array([2000.0]), 10).dtype == np.uint16


def test_smoothing_averages_rounded_codes() -> None:
    np.testing.assert_allclose(readout.smooth(np.full((9, 9), 10.4), 0.5), 10.0)
