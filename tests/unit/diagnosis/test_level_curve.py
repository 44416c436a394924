"""By how much levels change, told by bins of them."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from starling.diagnosis.transfer import tone_curve

LEVELS = np.random.default_rng(0).gamma(2.0, 12.0, (60, 80)).astype(np.float32)


def test_a_change_in_proportion_is_told_as_it_is():
    """To half a step of what it is looked up by, and neither more nor less in the mean."""
    curve = tone_curve.told(LEVELS, 4 * LEVELS + 3)
    assert (np.diff(curve.levels) > 0).all()
    inside = (curve.levels[0] < LEVELS) & (curve.levels[-1] > LEVELS)
    off = (curve.step(LEVELS) - (4 * LEVELS + 3))[inside]
    assert inside.mean() > 0.99
    assert np.abs(off).max() < 4 * 0.5 / 64 + 1e-3
    assert abs(off.mean()) < 2e-3
    assert_allclose(curve.of(LEVELS), 5 * LEVELS + 3, atol=0.04)


def test_dark_and_bright_levels_are_told_alike():
    """Of the image turned over, the curve is the same turned over."""
    codes = np.floor(LEVELS)
    bent = np.sqrt(codes)
    curve, turned = (tone_curve.told(one, bent) for one in (codes, 200 - codes))
    assert_allclose(turned.levels[::-1], 200 - curve.levels, atol=1e-6)
    assert_allclose(turned.change[::-1], curve.change, atol=1e-6)


def test_an_even_image_changes_by_its_mean():
    """Of one level there is no slope to go on by."""
    even = np.full((4, 5), 7.25, np.float32)
    change = np.where(np.arange(5) < 2, 1.0, 2.0) * np.ones((4, 1))
    curve = tone_curve.told(even, change)
    assert curve.step(even) == pytest.approx(np.full((4, 5), 1.6))
    assert_allclose(curve.of(even + np.float32(3)), 10.25 + 1.6, rtol=1e-6)
