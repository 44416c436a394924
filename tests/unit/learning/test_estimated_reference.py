"""Reference depth that is estimated from the depth of a device."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from starling.learning.data import estimated_reference
from tests.unit.learning.step_scenes import INFO

WIDTH, HEIGHT = 200, 60
CAMERA = dataclasses.replace(INFO, width=WIDTH, height=HEIGHT)


def disparity(estimated: np.ndarray) -> np.ndarray:
    return CAMERA.disparity_px(estimated)


def image(px: np.ndarray) -> np.ndarray:
    """Depth of disparities."""
    return CAMERA.disparity_px(px.astype(np.float32))


def wall(px: float = 20.0) -> np.ndarray:
    return np.full((HEIGHT, WIDTH), px)


def test_a_shadow_continues_the_background() -> None:
    px = wall()
    px[:, 80:120] = 30
    px[:, 70:80] = px[:, 120:125] = np.nan
    estimated = disparity(estimated_reference.estimate(image(px), CAMERA))
    np.testing.assert_allclose(estimated[:, 68:80], 20, atol=0.05)
    np.testing.assert_allclose(estimated[:, 80:120], 30, atol=0.05)
    np.testing.assert_allclose(estimated[:, 120:130], 20, atol=0.05)


def test_a_hole_within_a_slope_is_interpolated() -> None:
    px = np.linspace(20, 30, WIDTH) + wall(0)
    holed = px.copy()
    holed[20:40, 90:105] = np.nan
    estimated = disparity(estimated_reference.estimate(image(holed), CAMERA))
    np.testing.assert_allclose(estimated[:, 20:-20], px[:, 20:-20], atol=0.05)


def test_what_no_rim_encloses_is_unknown() -> None:
    px = wall()
    px[:, :15] = px[:, 185:] = np.nan  # At the sides.
    px[:, 50:75] = np.nan  # Wider than a tenth.
    unknown = np.isnan(px)
    estimated = estimated_reference.estimate(image(px), CAMERA)
    np.testing.assert_array_equal(np.isnan(estimated), unknown)
    assert np.isnan(estimated_reference.estimate(image(px * np.nan), CAMERA)).all()


@pytest.mark.parametrize("sigma_px", [0.05, 0.1])
def test_holes_are_as_smooth_as_surfaces(sigma_px: float) -> None:
    """Noise of the device does not show where it has depth."""
    px = np.random.default_rng(0).normal(20, sigma_px, (HEIGHT, WIDTH))
    px[:, 90:105] = np.nan
    estimated = disparity(estimated_reference.estimate(image(px), CAMERA))
    assert np.std(np.diff(estimated[:, 20:80])) < 0.05 * sigma_px
