"""The variance of whole codes against drawn noise, and its inverse."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from starling.calibration.photometry import quantised_noise


@pytest.mark.parametrize("sigma_dn", [0.1, 0.2, 0.3, 0.6, 2.0])
def test_variance_in_time_of_rounded_noise(sigma_dn: float) -> None:
    """Levels anywhere within a step; does not say what levels of one place in it read."""
    rng = np.random.default_rng(1)
    level = rng.uniform(20, 60, 400_000)
    codes = [np.rint(level + sigma_dn * rng.standard_normal(level.size)) for _ in range(2)]
    seen = ((codes[1] - codes[0]) ** 2).mean() / 2
    assert quantised_noise.read(np.array(sigma_dn**2)) == pytest.approx(seen, rel=0.02)


def test_no_noise_reads_none() -> None:
    assert quantised_noise.read(np.array(0.0)) == pytest.approx(0.0, abs=1e-12)


@given(st.floats(0.003, 1e4))
def test_back_to_the_variance_before(variance_dn2: float) -> None:
    read = quantised_noise.read(np.array(variance_dn2))
    assert quantised_noise.before(read) == pytest.approx(variance_dn2, rel=1e-3)


def test_equal_codes_had_no_noise() -> None:
    """Exactly: copies of a frame are told by it."""
    assert not quantised_noise.before(np.array([0.0, -0.01])).any()
