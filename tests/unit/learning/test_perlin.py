"""Gradient noise: marginal, correlation in space and time, seeds."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from starling.learning.sampling import perlin
from starling.learning.sampling.perlin import Perlin
from starling.patterns.errors import InputError


def many(noise: Perlin, *, shape: tuple[int, int] = (96, 128), frame: float = 0.0) -> np.ndarray:
    return np.stack([perlin.standard(shape, noise, seed=s, frame=frame) for s in range(60)])


def test_share_below_a_threshold_is_the_threshold():
    """Within 8 % of p or 0.001, over 60 draws; a single draw has few independent patches."""
    noise = Perlin(correlation_px=2.0, correlation_frames=5.0)
    draws = np.stack([perlin.uniform((96, 128), noise, seed=s) for s in range(60)])
    for p in (0.005, 0.02, 0.1, 0.3, 0.5, 0.9, 0.98):
        assert np.mean(draws < p) == pytest.approx(p, rel=0.08, abs=0.001)
    assert draws.min() >= 0
    assert draws.max() < 1


def test_the_lattice_is_invisible():
    """Plain gradient noise is zero on its lattice; here every pixel has the same variance.

    The tolerance is the scatter of a variance of 400 draws (four standard deviations: 28 %).
    """
    noise = Perlin(correlation_px=3.0, correlation_frames=5.0)
    draws = np.stack([perlin.standard((24, 24), noise, seed=s) for s in range(400)])
    assert draws.var(axis=0) == pytest.approx(np.ones((24, 24)), abs=0.28)
    assert np.abs(draws.mean(axis=0)).max() < 0.25


@pytest.mark.parametrize("correlation_px", [3, 8])
def test_the_correlation_is_one_half_at_the_requested_length(correlation_px):
    """In both directions, within 0.05, the effect of the local variance on the closed form."""
    noise = Perlin(correlation_px=correlation_px, correlation_frames=5.0)
    z = many(noise)
    across = np.mean(z[:, :, :-correlation_px] * z[:, :, correlation_px:])
    down = np.mean(z[:, :-correlation_px] * z[:, correlation_px:])
    assert across == pytest.approx(0.5, abs=0.05)
    assert down == pytest.approx(0.5, abs=0.05)


@pytest.mark.parametrize("later", [1, 4, 8])
def test_correlation_in_time_is_normal(later):
    noise = Perlin(correlation_px=2.0, correlation_frames=4.0)
    measured = np.mean(many(noise) * many(noise, frame=later))
    assert measured == pytest.approx(math.exp(-((later / 4) ** 2) / 2), abs=0.02)


def test_frames_have_equal_strength():
    """Slices of noise in three dimensions would change in strength; rotating gradients do not."""
    noise = Perlin(correlation_px=2.0, correlation_frames=4.0)
    for frame in (0.0, 1.5, 2.0, 7.0):
        assert many(noise, frame=frame).var() == pytest.approx(1, abs=0.03)


@settings(max_examples=20)
@given(
    height=st.integers(1, 70),
    width=st.integers(1, 70),
    seed=st.integers(0, 2**40),
    correlation_px=st.floats(0.3, 200),
)
def test_any_size_is_bit_identical_by_seed(height, width, seed, correlation_px):
    noise = Perlin(correlation_px=correlation_px, correlation_frames=3.0)
    item = perlin.uniform((height, width), noise, seed=seed, frame=2.5)
    np.testing.assert_array_equal(
        item, perlin.uniform((height, width), noise, seed=seed, frame=2.5)
    )
    assert item.shape == (height, width)
    assert np.isfinite(item).all()
    assert (item != perlin.uniform((height, width), noise, seed=seed + 1, frame=2.5)).any()


def test_nothing_repeats():
    """A table of 256 gradients would repeat after 256 cells."""
    noise = Perlin(correlation_px=0.5, correlation_frames=3.0)
    z = perlin.standard((8, 4000), noise, seed=3)
    power = np.abs(np.fft.rfft(z - z.mean(axis=1, keepdims=True), 8192, axis=1)) ** 2
    correlation = np.fft.irfft(power.mean(axis=0))
    period = correlation[50:3000] / correlation[0]
    assert np.abs(period).max() < 0.15


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"correlation_px": 0.0}, r"correlation_px must be > 0; got 0\.0"),
        ({"correlation_frames": math.nan}, "correlation_frames must be > 0; got nan"),
    ],
)
def test_invalid_noise_is_refused(changes, message):
    with pytest.raises(InputError, match=message):
        Perlin(**({"correlation_px": 2.0, "correlation_frames": 5.0} | changes))


def test_empty_image_is_refused():
    noise = Perlin(correlation_px=2.0, correlation_frames=5.0)
    with pytest.raises(InputError, match=r"height must be an integer in \[1, 16384\]; got 0"):
        perlin.uniform((0, 5), noise, seed=0)
    with pytest.raises(InputError, match="width must be"):
        perlin.uniform((5, 0), noise, seed=0)
