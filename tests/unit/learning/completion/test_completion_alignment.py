"""Scale and shift: found again exactly, least in the squares, refused where they could be any."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from learning.completion.alignment import (
    aligned,
    aligned_inverse,
    least_squares,
    normalisation,
)
from patterns.errors import InputError

RNG = np.random.default_rng(0)
DEPTH = RNG.uniform(0.5, 4, (12, 16)).astype(np.float32)
ALL = np.ones(DEPTH.shape, bool)


@settings(max_examples=50, deadline=None)
@given(st.floats(0.01, 100), st.floats(-50, 50))
def test_what_differs_by_scale_and_shift_is_found_again(scale: float, shift: float) -> None:
    found = aligned((DEPTH.astype(np.float64) - shift) / scale, DEPTH, ALL)
    np.testing.assert_allclose(found, DEPTH, rtol=1e-5)


def test_no_other_scale_and_shift_is_nearer() -> None:
    prediction = DEPTH**2 + RNG.normal(0, 0.2, DEPTH.shape)
    best = least_squares(prediction, DEPTH, ALL)
    error = np.square(best.scale * prediction + best.shift - DEPTH).sum()
    for scale, shift in ((1e-3, 0.0), (-1e-3, 0.0), (0.0, 1e-3), (0.0, -1e-3)):
        other = (best.scale + scale) * prediction + best.shift + shift
        assert np.square(other - DEPTH).sum() > error
    slope, offset = np.polyfit(prediction.ravel(), DEPTH.ravel(), 1)
    assert (best.scale, best.shift) == pytest.approx((slope, offset))


def test_only_what_counts_counts() -> None:
    """What the robot can do: aligned where the camera has depth, used where it has none."""
    valid = RNG.random(DEPTH.shape) < 0.5
    sensor = np.where(valid, DEPTH, np.float32(np.nan))
    np.testing.assert_allclose(aligned(3 * DEPTH - 1, sensor, valid), DEPTH, rtol=1e-5)
    wrong = np.where(valid, DEPTH, np.float32(99))
    np.testing.assert_allclose(aligned(3 * DEPTH - 1, wrong, valid), DEPTH, rtol=1e-5)


def test_what_comes_out_behind_the_camera_is_no_depth() -> None:
    prediction = DEPTH.copy()
    prediction[0, 0] = -100
    where = ALL.copy()
    where[0, 0] = False
    assert np.isnan(aligned(prediction, DEPTH, where)[0, 0])


def test_inverse_depth_is_aligned_in_inverse_depth() -> None:
    prediction = 5 / DEPTH + 2
    prediction[0, 0] = 2  # Infinitely far.
    where = ALL.copy()
    where[0, 0] = False
    found = aligned_inverse(prediction, DEPTH, where, farthest_m=20.0)
    np.testing.assert_allclose(found[where], DEPTH[where], rtol=1e-4)
    assert found[0, 0] == pytest.approx(20.0)


@pytest.mark.parametrize("trimmed", [0.0, 2.0])
def test_normalised_depth_comes_back(trimmed: float) -> None:
    found = normalisation(DEPTH, ALL, trimmed_pct=trimmed)
    np.testing.assert_allclose(found.denormalise(found(DEPTH)), DEPTH, rtol=1e-5)
    inside = np.mean(np.abs(found(DEPTH)) <= 1 + 1e-6)
    assert inside == pytest.approx(1 - 2 * trimmed / 100, abs=0.02)


def test_holes_do_not_count_in_the_normalisation() -> None:
    valid = DEPTH < 2
    holes = np.where(valid, DEPTH, np.float32(np.nan))
    found = normalisation(holes, valid, trimmed_pct=0.0)
    assert found.high_m == pytest.approx(DEPTH[valid].max())


def test_alignment_refuses() -> None:
    with pytest.raises(InputError, match="prediction, target and where must share one shape"):
        least_squares(DEPTH[:3], DEPTH, ALL)
    with pytest.raises(InputError, match="must have 2 pixels in common, or more; got 0"):
        least_squares(DEPTH, DEPTH * np.nan, ALL)
    for constant in (np.full_like(DEPTH, 0.7), np.zeros_like(DEPTH)):
        with pytest.raises(InputError, match="prediction must vary where it is aligned"):
            least_squares(constant, DEPTH, ALL)
    with pytest.raises(InputError, match="farthest_m must be > 0"):
        aligned_inverse(DEPTH, DEPTH, ALL, farthest_m=0.0)
    with pytest.raises(InputError, match="depth must be valid at 2 pixels or more; got 0"):
        normalisation(DEPTH, ~ALL)
    with pytest.raises(InputError, match="depth must vary to be normalised; got 1 to 1 m"):
        normalisation(np.ones_like(DEPTH), ALL)
    with pytest.raises(InputError, match=r"trimmed_pct must be in \[0, 49\]"):
        normalisation(DEPTH, ALL, trimmed_pct=50.0)
