"""Modulation of a view and the weights of its pixels."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from starling.calibration.pattern import views
from starling.calibration.pattern.views import Modulation, PatternView

SHAPE = (60, 90)
BLACK_DN, DN_PER_ELECTRON = 16.0, 0.05
DOTS = np.where(
    np.indices(SHAPE).sum(axis=0) % 2, 1.0, -1.0
)  # The high-pass filter does not change them.


def view(level: np.ndarray) -> PatternView:
    usable = np.ones(SHAPE, bool)
    usable[:5] = False
    return PatternView(
        scene="a",
        room="a",
        side="left",
        level_dn=level.astype(np.float32),
        points_m=np.zeros((*SHAPE, 3), np.float32),
        usable=usable,
    )


def modulated(pattern_view: PatternView) -> Modulation:
    return views.modulate(pattern_view, dn_per_electron=DN_PER_ELECTRON, black_level_dn=BLACK_DN)


@pytest.mark.parametrize("reflectance", [0.3, 1.0])
@pytest.mark.parametrize("ambient", [0.0, 50.0])
def test_reflectance_and_level_drop_out(reflectance: float, ambient: float) -> None:
    """The weight is the variance of dots of 10 DN over that of shot noise and rounding."""
    result = modulated(view(BLACK_DN + reflectance * (20 + 10 * DOTS + ambient)))
    np.testing.assert_allclose(result.value, DOTS, rtol=1e-3)
    noise = 1 / 12 + DN_PER_ELECTRON * reflectance * (20 + ambient)
    expected = min((10 * reflectance) ** 2 / noise, 50.0)
    np.testing.assert_allclose(result.weight[5:], expected, rtol=5e-3)
    assert not result.weight[:5].any()


def test_contrast_below_half_a_code_is_not_amplified() -> None:
    """On a uniform surface, quantisation steps stay small and have a low weight."""
    result = modulated(view(BLACK_DN + 20 + 0.1 * DOTS))
    np.testing.assert_allclose(result.value, 0.2 * DOTS, rtol=2e-3)
    dark = modulated(view(BLACK_DN - 3 + 0.1 * DOTS))
    np.testing.assert_allclose(dark.weight[5:], 0.12, rtol=2e-2)


def test_unusable_pixels_have_a_value_but_no_weight() -> None:
    plain = view(BLACK_DN + 20 + 10 * DOTS)
    blind = modulated(dataclasses.replace(plain, usable=np.zeros(SHAPE, bool)))
    assert not blind.weight.any()
    np.testing.assert_array_equal(blind.value, modulated(plain).value)
