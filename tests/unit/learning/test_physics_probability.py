"""Simulated probability: the smoothed share of draws without depth."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter

from starling.learning.data.example import Physics
from starling.learning.data.physics import PLACE_PX, as_precise_as_physics, physics_probability
from starling.patterns.errors import InputError
from tests.unit.learning.step_scenes import SHAPE, step_scene


def _drawn(share: np.ndarray, draws: int) -> Physics:
    physics = step_scene(0).physics
    assert physics is not None
    return dataclasses.replace(physics, ndp=share.astype(np.float32), draws=draws)


@given(st.integers(1, 64), st.integers(0, 1000))
def test_it_is_the_posterior_mean_of_the_local_share(draws: int, seed: int) -> None:
    """(k' + m) / (n + 1), compared with the Gaussian of another library."""
    k = np.random.default_rng(seed).integers(0, draws + 1, SHAPE)
    report = physics_probability(_drawn(k / draws, draws))
    nearby = gaussian_filter(k.astype(np.float64), PLACE_PX, mode="nearest", truncate=4.0)
    np.testing.assert_allclose(report, (nearby + k.mean() / draws) / (draws + 1), rtol=2e-3)


def test_the_edge_of_a_hole_is_smoothed_by_its_position_uncertainty() -> None:
    """One half at the edge, and the Gaussian's 0.16 and 0.84 at one sigma from it."""
    share = np.zeros(SHAPE)
    share[:, 32:] = 1
    report = physics_probability(_drawn(share, 10**6))
    edge = report[:, 31:33].mean()
    assert edge == pytest.approx(0.5, abs=0.001)
    neighbour = [report[:, column - 1 : column + 1].mean() for column in (28, 36)]
    np.testing.assert_allclose(neighbour, [0.1587, 0.8413], atol=0.002)


@pytest.mark.parametrize("share", [0.0, 1.0])
def test_it_is_never_certain(share: float) -> None:
    report = physics_probability(_drawn(np.full(SHAPE, share), 8))
    assert ((report > 0) & (report < 1)).all()


@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_a_constant_share_does_not_change(share: float) -> None:
    report = physics_probability(_drawn(np.full(SHAPE, share), 8))
    np.testing.assert_allclose(report, np.clip(share, 1e-3 / 9, 1 - 1e-3 / 9), atol=1e-6)


def test_refuses_no_draws() -> None:
    with pytest.raises(InputError, match=r"draws must be in \[1, .*; got 0. Simulate"):
        physics_probability(_drawn(np.zeros(SHAPE), 0))


@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_smoothing_keeps_the_data_type(kind: type[np.floating]) -> None:
    image = np.random.default_rng(0).random(SHAPE).astype(kind)
    smoothed = as_precise_as_physics(image)
    assert smoothed.dtype == kind
    wanted = gaussian_filter(image.astype(np.float64), PLACE_PX, mode="nearest")
    np.testing.assert_allclose(smoothed, wanted, atol=2e-3)
