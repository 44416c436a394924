"""Disparity refinement effects on a matched map."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from starling.diagnosis.validation.camera import disparity_filters

NAN = np.nan


def _map(seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    d = 20.0 + rng.normal(0, 0.3, (24, 30))
    d[rng.random(d.shape) < 0.1] = NAN
    return d


@pytest.mark.parametrize(
    "refine",
    [
        lambda d: disparity_filters.median(d, 0),
        lambda d: disparity_filters.lock(d, 0.0),
        lambda d: disparity_filters.steps(d, 0.0),
        lambda d: disparity_filters.without_islands(d, 0, 1.0),
    ],
)
def test_no_effect_returns_the_map_itself(refine) -> None:
    d = _map()
    assert refine(d) is d


@pytest.mark.parametrize("side", [3, 5])
def test_median_is_of_the_valid_neighbours(side: int) -> None:
    d = _map()
    out = disparity_filters.median(d, side)
    np.testing.assert_array_equal(np.isnan(out), np.isnan(d))
    padded = np.pad(d, side // 2, constant_values=NAN)
    for row, column in ((0, 0), (10, 12), (23, 29)):
        if np.isfinite(d[row, column]):
            window = padded[row : row + side, column : column + side]
            assert out[row, column] == pytest.approx(np.nanmedian(window))


@given(amplitude=st.floats(-0.15, 0.15))
def test_locking_is_a_sine_of_the_fraction(amplitude: float) -> None:
    d = np.linspace(10.0, 12.0, 201)[None]
    error = disparity_filters.lock(d, amplitude) - d
    np.testing.assert_allclose(error, -amplitude * np.sin(2 * np.pi * d), atol=1e-12)


def test_steps() -> None:
    out = disparity_filters.steps(np.array([[1.1, 1.13, NAN]]), 0.25)
    assert out[0, :2].tolist() == [1.0, 1.25]
    assert np.isnan(out[0, 2])


def test_islands_by_count() -> None:
    """Islands of at most `count` pixels are removed. Steps above the limit separate islands."""
    d = np.full((10, 30), NAN)
    d[2:4, 2:5] = 7.0  # Six pixels.
    d[2:4, 10:17] = 7.0
    d[2, 10] = 20.0  # One pixel at another disparity, so that 13 remain.
    out = disparity_filters.without_islands(d, 6, 1.0)
    assert np.isnan(out[2:4, 2:5]).all()
    assert np.isnan(out[2, 10])
    assert np.isfinite(out).sum() == 13
    assert np.isfinite(disparity_filters.without_islands(d, 5, 1.0)).sum() == 19


def test_rounded_depth_does_not_separate_islands() -> None:
    """A staircase of 1 px steps stays one island after rounding of depth to millimetres.

    Steps wider than the rounding error still separate islands.
    """
    fb, unit_m = 10.6, 0.001
    stairs = np.repeat(np.arange(10.0, 50.0), 3)[None] + np.linspace(0.0, 0.9, 7)[:, None]
    rounded = fb / (np.rint(fb / stairs / unit_m) * unit_m)
    assert (np.abs(np.diff(rounded, axis=1)) > 1.0).any()
    half_unit = 0.5 * unit_m / fb
    out = disparity_filters.without_islands(rounded, 100, 1.0, half_unit_per_px=half_unit)
    assert np.isfinite(out).all()
    wide = np.where(stairs < 30.0, rounded, fb / (fb / rounded - 0.003))  # Three units nearer.
    out = disparity_filters.without_islands(wide, stairs.size - 1, 1.0, half_unit_per_px=half_unit)
    assert np.isnan(out).all()
