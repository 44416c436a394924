"""Tone curves fitted to the change of an image."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from starling.diagnosis.transfer import tone_curve

LEVELS = np.random.default_rng(0).gamma(2.0, 12.0, (60, 80)).astype(np.float32)


def test_a_linear_curve_is_recovered():
    """To half a step of the lookup table, without bias."""
    curve = tone_curve.fit_tone_curve(LEVELS, 4 * LEVELS + 3)
    assert (np.diff(curve.levels) > 0).all()
    inside = (curve.levels[0] < LEVELS) & (curve.levels[-1] > LEVELS)
    error = (curve.change_at(LEVELS) - (4 * LEVELS + 3))[inside]
    assert inside.mean() > 0.99
    assert np.abs(error).max() < 4 * 0.5 / 64 + 1e-3
    assert abs(error.mean()) < 2e-3
    assert_allclose(curve.apply(LEVELS), 5 * LEVELS + 3, atol=0.04)


def test_dark_and_bright_levels_are_binned_equally():
    """The curve of the inverted image is the inverted curve."""
    codes = np.floor(LEVELS)
    bent = np.sqrt(codes)
    curve, inverted = (tone_curve.fit_tone_curve(image, bent) for image in (codes, 200 - codes))
    assert_allclose(inverted.levels[::-1], 200 - curve.levels, atol=1e-6)
    assert_allclose(inverted.change[::-1], curve.change, atol=1e-6)


def test_a_uniform_image_changes_by_the_mean():
    """A single level has no slope for extrapolation."""
    uniform = np.full((4, 5), 7.25, np.float32)
    change = np.where(np.arange(5) < 2, 1.0, 2.0) * np.ones((4, 1))
    curve = tone_curve.fit_tone_curve(uniform, change)
    assert curve.change_at(uniform) == pytest.approx(np.full((4, 5), 1.6))
    assert_allclose(curve.apply(uniform + np.float32(3)), 10.25 + 1.6, rtol=1e-6)
