"""Scale and shift: recovery, least squares, and refusals of undetermined cases."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from starling.learning.completion.alignment import (
    Normalisation,
    align_depth,
    align_inverse_depth,
    align_to_target,
    least_squares,
    normalisation,
)
from starling.patterns.errors import InputError

RNG = np.random.default_rng(0)
DEPTH = RNG.uniform(0.5, 4, (12, 16)).astype(np.float32)
ALL = np.ones(DEPTH.shape, bool)


@settings(max_examples=50, deadline=None)
@given(st.floats(0.01, 100), st.floats(-50, 50))
def test_scale_and_shift_are_recovered(scale: float, shift: float) -> None:
    result = align_depth((DEPTH.astype(np.float64) - shift) / scale, DEPTH, ALL)
    np.testing.assert_allclose(result, DEPTH, rtol=1e-5)


def test_least_squares_is_the_minimum() -> None:
    prediction = DEPTH**2 + RNG.normal(0, 0.2, DEPTH.shape)
    best = least_squares(prediction, DEPTH, ALL)
    error = np.square(best.scale * prediction + best.shift - DEPTH).sum()
    for scale, shift in ((1e-3, 0.0), (-1e-3, 0.0), (0.0, 1e-3), (0.0, -1e-3)):
        second = (best.scale + scale) * prediction + best.shift + shift
        assert np.square(second - DEPTH).sum() > error
    slope, offset = np.polyfit(prediction.ravel(), DEPTH.ravel(), 1)
    assert (best.scale, best.shift) == pytest.approx((slope, offset))


def test_only_selected_pixels_are_fitted() -> None:
    """As on a robot: aligned where the camera has depth, used where it has none."""
    valid = RNG.random(DEPTH.shape) < 0.5
    sensor = np.where(valid, DEPTH, np.float32(np.nan))
    np.testing.assert_allclose(align_depth(3 * DEPTH - 1, sensor, valid), DEPTH, rtol=1e-5)
    wrong = np.where(valid, DEPTH, np.float32(99))
    np.testing.assert_allclose(align_depth(3 * DEPTH - 1, wrong, valid), DEPTH, rtol=1e-5)


def test_depth_behind_the_camera_is_missing() -> None:
    prediction = DEPTH.copy()
    prediction[0, 0] = -100
    where = ALL.copy()
    where[0, 0] = False
    assert np.isnan(align_depth(prediction, DEPTH, where)[0, 0])


def test_inverse_depth_is_aligned_in_inverse_depth() -> None:
    prediction = 5 / DEPTH + 2
    prediction[0, 0] = 2  # Infinitely far.
    where = ALL.copy()
    where[0, 0] = False
    result = align_inverse_depth(prediction, DEPTH, where, farthest_m=20.0)
    np.testing.assert_allclose(result[where], DEPTH[where], rtol=1e-4)
    assert result[0, 0] == pytest.approx(20.0)


def test_normalisation_is_inverted() -> None:
    result = normalisation(DEPTH, ALL)
    np.testing.assert_allclose(result.denormalise(result(DEPTH)), DEPTH, rtol=1e-5)
    inside = np.mean(np.abs(result(DEPTH)) <= 1 + 1e-6)
    assert inside == pytest.approx(0.96, abs=0.02)


def test_holes_do_not_count_in_the_normalisation() -> None:
    valid = DEPTH < 2
    holes = np.where(valid, DEPTH, np.float32(np.nan))
    result = normalisation(holes, valid)
    assert result.high_m == pytest.approx(np.percentile(DEPTH[valid], 98))


def test_alignment_refuses() -> None:
    with pytest.raises(InputError, match="prediction, target and where must share one shape"):
        least_squares(DEPTH[:3], DEPTH, ALL)
    with pytest.raises(InputError, match="must have 2 pixels in common, or more; got 0"):
        least_squares(DEPTH, DEPTH * np.nan, ALL)
    for constant in (np.full_like(DEPTH, 0.7), np.zeros_like(DEPTH)):
        with pytest.raises(InputError, match="prediction must vary where it is aligned"):
            least_squares(constant, DEPTH, ALL)
    with pytest.raises(InputError, match="farthest_m must be > 0"):
        align_inverse_depth(DEPTH, DEPTH, ALL, farthest_m=0.0)
    with pytest.raises(InputError, match="depth must be valid somewhere; got no pixel"):
        normalisation(DEPTH, ~ALL)
    with pytest.raises(InputError, match="depth must vary to be normalised; got 1 to 1 m"):
        Normalisation(low_m=1.0, high_m=1.0)


SENSOR = np.where(RNG.random(DEPTH.shape) < 0.5, 1.1 * DEPTH, np.float32(np.nan))


def test_depth_is_aligned_to_the_target() -> None:
    """An error of scale and shift only is removed."""
    off = (0.5 * DEPTH + 2).astype(np.float32)
    for target, expected in (("none", off), ("sensor", 1.1 * DEPTH), ("truth", DEPTH)):
        result = align_to_target(target, off, sensor_m=SENSOR, truth_m=DEPTH)
        np.testing.assert_allclose(result, expected, rtol=1e-4)


def test_aligning_the_camera_to_itself_changes_nothing() -> None:
    result = align_to_target("sensor", SENSOR, sensor_m=SENSOR, truth_m=DEPTH)
    np.testing.assert_allclose(result, SENSOR, rtol=1e-4)


def test_unknown_truth_is_ignored() -> None:
    truth = np.where(DEPTH < 2, DEPTH, np.float32(np.nan))
    off = np.where(DEPTH < 2, DEPTH + 1, np.float32(50))
    result = align_to_target("truth", off, sensor_m=SENSOR, truth_m=truth)
    np.testing.assert_allclose(result[DEPTH < 2], DEPTH[DEPTH < 2], rtol=1e-4)


def test_depth_that_cannot_be_aligned_is_missing() -> None:
    for useless in (np.full_like(DEPTH, 2), np.full_like(DEPTH, np.nan)):
        assert np.isnan(align_to_target("truth", useless, sensor_m=SENSOR, truth_m=DEPTH)).all()
        assert align_to_target("none", useless, sensor_m=SENSOR, truth_m=DEPTH) is useless


def test_an_unknown_target_is_refused() -> None:
    with pytest.raises(InputError, match=r"align must be a known name; got 'turth'\. Known: truth"):
        align_to_target("turth", DEPTH, sensor_m=SENSOR, truth_m=DEPTH)


def test_a_constant_depth_has_a_span():
    result = normalisation(np.full((5, 5), 2.0, np.float32), np.ones((5, 5), bool))
    assert (result.low_m, result.high_m) == pytest.approx((2.0, 2.02))
