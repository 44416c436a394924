"""How much a pixel counts in a fit of levels, against the variances that it is to have."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from starling.calibration.photometry import weights
from starling.calibration.photometry.light_model import Columns

SHAPE = (32, 48)  # Six tiles.
LEAST, PER_SIGNAL, PER_LASER = 2.0, 0.3, 0.04
RNG = np.random.default_rng(0)
LASER = RNG.uniform(0, 40, SHAPE).astype(np.float32)
COLUMN = Columns(
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
    """Constant, as the signal, as the laser's square, a hundredth of the signal, and a share of the
    tile's mean square of the laser."""
    used = LASER > 5
    given = np.full(SHAPE, factor, np.float32)
    found = weights.weight(image(used), COLUMN, given, misfit=misfit)
    laser = factor * LASER.astype(float)
    signal = factor * COLUMN.model.astype(float)
    tiles = (laser**2).reshape(2, 16, 3, 16).mean(axis=(1, 3)).repeat(16, 0).repeat(16, 1)
    variance = LEAST + PER_SIGNAL * signal + PER_LASER * laser**2
    variance += (0.01 * signal) ** 2 + misfit**2 * tiles
    np.testing.assert_allclose(found[used], 1 / variance[used], rtol=1e-5)
    assert not found[~used].any()


def test_a_factor_that_is_not_given_is_one() -> None:
    ones = np.ones(SHAPE, np.float32)
    one, other = (weights.weight(image(), COLUMN, given) for given in (None, ones))
    np.testing.assert_array_equal(one, other)


def test_less_light_than_none_has_no_less_noise() -> None:
    """A factor that noise has made negative leaves the imager's own noise."""
    found = weights.weight(image(), COLUMN, np.full(SHAPE, -0.1, np.float32))
    expected = LEAST + PER_LASER * (0.1 * LASER) ** 2 + (1e-3 * COLUMN.model) ** 2
    np.testing.assert_allclose(found, 1 / expected, rtol=1e-5)


def test_a_tile_s_factor_is_that_of_its_sums() -> None:
    """Of pixels that count; of neighbours too where asked; 1 where nothing counts."""
    factors = np.array([[0.5, 1.0, 2.0], [0.2, 0.4, 0.8]])
    signal = (COLUMN.model * factors.repeat(16, 0).repeat(16, 1)).astype(np.float32)
    used = np.ones(SHAPE, bool)
    used[:16, :16] = False
    used[20, 20] = False
    signal[20, 20] = 1e4
    found = weights.tile_factor(image(used), signal, COLUMN.model)
    expected = factors.copy()
    expected[0, 0] = 1.0
    np.testing.assert_allclose(found[::16, ::16], expected, rtol=1e-4)
    around = weights.tile_factor(image(used), signal, COLUMN.model, around=1)
    assert 0.5 < around[0, 0] < 1.0  # The mean of three, each about as bright.
