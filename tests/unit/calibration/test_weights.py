"""Weights of pixels in a fit of levels, against the expected variances."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from starling.calibration.photometry import prediction
from starling.calibration.photometry.light_model import LightColumns

SHAPE = (32, 48)  # Six tiles.
LEAST, PER_SIGNAL, PER_LASER = 2.0, 0.3, 0.04
RNG = np.random.default_rng(0)
LASER = RNG.uniform(0, 40, SHAPE).astype(np.float32)
COLUMN = LightColumns(
    model=LASER + np.float32(20),
    laser=LASER,
    sharp_laser=LASER,
    derivatives=(),
    variance=(LEAST, PER_SIGNAL, PER_LASER),
)


def image(used: np.ndarray | bool = True) -> Any:
    return SimpleNamespace(used=np.broadcast_to(used, SHAPE))


@pytest.mark.parametrize("factor", [1.0, 0.4])
@pytest.mark.parametrize("misfit", [0.0, 0.5])
def test_variances_of_noise_speckle_model_and_misfit_add_up(factor: float, misfit: float) -> None:
    """The variance sums read noise, shot noise, speckle, 1 % model error and dot misfit."""
    used = LASER > 5
    reflectance = np.full(SHAPE, factor, np.float32)
    result = prediction.weight(image(used), COLUMN, reflectance, misfit=misfit)
    laser = factor * LASER.astype(float)
    signal = factor * COLUMN.model.astype(float)
    tiles = (laser**2).reshape(2, 16, 3, 16).mean(axis=(1, 3)).repeat(16, 0).repeat(16, 1)
    variance = LEAST + PER_SIGNAL * signal + PER_LASER * laser**2
    variance += (0.01 * signal) ** 2 + misfit**2 * tiles
    np.testing.assert_allclose(result[used], 1 / variance[used], rtol=1e-5)
    assert not result[~used].any()


def test_a_negative_factor_keeps_the_imagers_noise() -> None:
    """A factor that is negative by noise leaves the noise of the imager."""
    result = prediction.weight(image(), COLUMN, np.full(SHAPE, -0.1, np.float32))
    expected = LEAST + PER_LASER * (0.1 * LASER) ** 2 + (1e-3 * COLUMN.model) ** 2
    np.testing.assert_allclose(result, 1 / expected, rtol=1e-5)


def test_a_tiles_factor_is_the_ratio_of_sums() -> None:
    """The factor uses the used pixels of a tile, or of adjacent tiles; it is 1 without any."""
    factors = np.array([[0.5, 1.0, 2.0], [0.2, 0.4, 0.8]])
    signal = (COLUMN.model * factors.repeat(16, 0).repeat(16, 1)).astype(np.float32)
    used = np.ones(SHAPE, bool)
    used[:16, :16] = False
    used[20, 20] = False
    signal[20, 20] = 1e4
    result = prediction.tile_factor(image(used), signal, COLUMN.model)
    expected = factors.copy()
    expected[0, 0] = 1.0
    np.testing.assert_allclose(result[::16, ::16], expected, rtol=1e-4)
    around = prediction.tile_factor(image(used), signal, COLUMN.model, around=1)
    assert 0.5 < around[0, 0] < 1.0  # The mean of three, each about as bright.
