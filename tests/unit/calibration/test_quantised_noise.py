"""The variance of quantised codes against simulated noise, and its inverse."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from starling.calibration.photometry.photon_transfer import (
    quantised_variance,
    unquantised_variance,
)


@pytest.mark.parametrize("sigma_dn", [0.1, 0.2, 0.3, 0.6, 2.0])
def test_temporal_variance_of_rounded_noise(sigma_dn: float) -> None:
    """The variance is averaged over levels within a step."""
    rng = np.random.default_rng(1)
    level = rng.uniform(20, 60, 400_000)
    codes = [np.rint(level + sigma_dn * rng.standard_normal(level.size)) for _ in range(2)]
    seen = ((codes[1] - codes[0]) ** 2).mean() / 2
    assert quantised_variance(np.array(sigma_dn**2)) == pytest.approx(seen, rel=0.02)


def test_zero_noise_has_zero_variance() -> None:
    assert quantised_variance(np.array(0.0)) == pytest.approx(0.0, abs=1e-12)


@given(st.floats(0.003, 1e4))
def test_unquantised_variance_inverts_quantised_variance(variance_dn2: float) -> None:
    read = quantised_variance(np.array(variance_dn2))
    assert unquantised_variance(read) == pytest.approx(variance_dn2, rel=1e-3)


def test_equal_codes_have_no_noise() -> None:
    """The result is exactly 0, which detects copies of a frame."""
    assert not unquantised_variance(np.array([0.0, -0.01])).any()
