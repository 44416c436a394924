"""A view without reflectance and level, and how much each of its pixels says."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from starling.calibration.pattern import modulation
from starling.calibration.pattern.views import View

SHAPE = (60, 90)
BLACK_DN, DN_PER_ELECTRON = 16.0, 0.05
DOTS = np.where(np.indices(SHAPE).sum(axis=0) % 2, 1.0, -1.0)  # High-passed they are as they were.


def view(level: np.ndarray) -> View:
    usable = np.ones(SHAPE, bool)
    usable[:5] = False
    return View(
        scene="a",
        room="a",
        side="left",
        level_dn=level.astype(np.float32),
        points_m=np.zeros((*SHAPE, 3), np.float32),
        usable=usable,
    )


def of(one: View) -> modulation.Modulation:
    return modulation.of(one, dn_per_electron=DN_PER_ELECTRON, black_level_dn=BLACK_DN)


@pytest.mark.parametrize("reflectance", [0.3, 1.0])
@pytest.mark.parametrize("ambient", [0.0, 50.0])
def test_reflectance_and_level_drop_out(reflectance: float, ambient: float) -> None:
    """Of dots of 10 DN; the weight is their variance over that of light's noise and of rounding."""
    found = of(view(BLACK_DN + reflectance * (20 + 10 * DOTS + ambient)))
    np.testing.assert_allclose(found.value, DOTS, rtol=1e-3)
    noise = 1 / 12 + DN_PER_ELECTRON * reflectance * (20 + ambient)
    expected = min((10 * reflectance) ** 2 / noise, 50.0)
    np.testing.assert_allclose(found.weight[5:], expected, rtol=5e-3)
    assert not found.weight[:5].any()


def test_less_than_half_a_code_is_no_dot() -> None:
    """Of an even surface the converter's steps stay small, and count little."""
    found = of(view(BLACK_DN + 20 + 0.1 * DOTS))
    np.testing.assert_allclose(found.value, 0.2 * DOTS, rtol=2e-3)
    dark = of(view(BLACK_DN - 3 + 0.1 * DOTS))
    np.testing.assert_allclose(dark.weight[5:], 0.12, rtol=2e-2)


def test_what_is_not_usable_keeps_its_value_and_has_no_weight() -> None:
    plain = view(BLACK_DN + 20 + 10 * DOTS)
    blind = of(dataclasses.replace(plain, usable=np.zeros(SHAPE, bool)))
    assert not blind.weight.any()
    np.testing.assert_array_equal(blind.value, of(plain).value)
