"""Interpolation between pixels, and the sums of spectra over bands."""

from __future__ import annotations

import numpy as np
import pytest

from starling.diagnosis.where.coherence import registration, sampling, spectra
from starling.diagnosis.where.coherence.spectra import BANDS, WINDOW_PX

X, Y = (axis.astype(np.float32) for axis in np.meshgrid(np.arange(256), np.arange(128)))


@pytest.mark.parametrize("fraction", [0.0, 0.25, 0.5])
@pytest.mark.parametrize("number", [4, 16, 24])
def test_transfer_is_that_of_a_wave(fraction: float, number: int) -> None:
    """A sampled wave of 64 / n px has the amplitude that the transfer predicts."""
    frequency = number / WINDOW_PX
    wave = np.cos(2 * np.pi * frequency * X)
    moved = sampling.sample(wave, X + np.float32(fraction), Y)[32:96, 64:192]
    shifted = np.cos(2 * np.pi * frequency * (X + fraction))[32:96, 64:192]
    predicted = sampling.transfer(X + np.float32(fraction), Y, np.ones(X.shape, bool))
    amplitude = float((moved * shifted).mean() / (shifted**2).mean())
    assert predicted.amplitude[0, number] == pytest.approx(amplitude, abs=0.01)
    assert predicted.power[0, number] == pytest.approx((moved**2).mean() / 0.5, abs=0.02)


def test_whole_pixels_lose_nothing() -> None:
    kept = sampling.transfer(X + 3, Y - 2, np.ones(X.shape, bool))
    np.testing.assert_allclose(kept.amplitude, 1, atol=1e-6)
    np.testing.assert_allclose(kept.power, 1, atol=1e-6)


def test_bands_hold_the_power_of_white_noise() -> None:
    """A band holds the share of the frequency plane that it covers."""
    noise = np.random.default_rng(0).normal(0, 3, (512, 512)).astype(np.float32)
    known = np.ones(noise.shape, bool)
    cells = spectra.cells_within(known)
    transformed = spectra.window_spectra(noise, known, cells)
    power = spectra.band_sums(spectra.cross(transformed, transformed)) / len(cells)
    outer, inner = ([1 / each for each in ends] for ends in ((2, 4, 8), (4, 8, 16)))
    area = np.pi * (np.square(outer) - np.square(inner))
    np.testing.assert_allclose(power[:3], 9 * area, rtol=0.05)
    assert len(power) == len(BANDS)


def test_independent_samples_give_the_spread_of_a_cross_spectrum() -> None:
    """The bias of the explained share needs this number."""
    rng = np.random.default_rng(1)
    known = np.ones((256, 256), bool)
    cells = spectra.cells_within(known)
    values = []
    for _ in range(200):
        first, second = (
            spectra.window_spectra(rng.normal(size=known.shape).astype(np.float32), known, cells)
            for _ in range(2)
        )
        values.append(spectra.band_sums(spectra.cross(first, second)) / len(cells))
    white = spectra.window_spectra(rng.normal(size=known.shape).astype(np.float32), known, cells)
    power = spectra.band_sums(spectra.cross(white, white)) / len(cells)
    expected = power / np.sqrt(2 * len(cells) * spectra.SAMPLES)
    np.testing.assert_allclose(np.std(values, axis=0)[:4], expected[:4], rtol=0.2)


def test_windows_need_known_pixels() -> None:
    known = np.ones((160, 160), bool)
    assert len(spectra.cells_within(known)) == 16
    known[:, 100:] = False
    cells = spectra.cells_within(known)
    columns = np.unravel_index(cells, spectra.grid_shape(known.shape))[1]
    assert set(columns) == {0, 1}
    assert not len(spectra.cells_within(known[:40]))


def test_noise_is_not_registered() -> None:
    rng = np.random.default_rng(2)
    known = np.ones((512, 512), bool)
    cells = spectra.cells_within(known)
    first, second = (
        spectra.window_spectra(rng.normal(size=known.shape).astype(np.float32), known, cells)
        for _ in range(2)
    )
    shifts = registration.window_shifts(first, second)
    assert not np.isfinite(shifts).any()
    assert not registration.shift_map(shifts, cells, known.shape).any()
    assert len(registration.window_shifts(first[:0], second[:0])) == 0
