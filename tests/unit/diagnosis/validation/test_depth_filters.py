"""Effects on matched depth."""

from __future__ import annotations

import numpy as np
import pytest

from starling.diagnosis.validation.camera import depth_filters
from starling.diagnosis.validation.camera.catalogue import Strengths
from starling.diagnosis.validation.camera.nominal import Nominal

NAN = np.nan


def _depth(seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    z = 1.0 + rng.normal(0, 0.005, (25, 33))
    z[rng.random(z.shape) < 0.2] = NAN
    return z


def test_no_effect_returns_the_map_itself(camera: Nominal) -> None:
    z = _depth()
    assert depth_filters.process(z, Strengths(nominal=camera, values={})) is z


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("median", 5),
        ("subpixel_steps", 0.5),
        ("pixel_locking", 0.1),
        ("speckle_filter", 60),
        ("range", 1.0),
        ("spatial_filter", 0.5),
        ("hole_filling", 2),
        ("depth_unit", 0.01),
    ],
)
def test_every_effect_changes_the_map(name: str, value: float, camera: Nominal) -> None:
    z = _depth()
    out = depth_filters.process(z, Strengths(nominal=camera, values={name: value}))
    assert not np.array_equal(out, z, equal_nan=True)


def test_islands_ignore_the_rounding_of_depth(camera: Nominal) -> None:
    """Disparities within the step of the effect page stay joined after rounding to whole units."""
    fb, unit_m = camera.focal_baseline_px_m, camera.depth_unit_m
    disparity_px = np.repeat(np.arange(8.0, 40.0), 2)[None] + np.linspace(0.0, 0.9, 5)[:, None]
    z = np.rint(fb / disparity_px / unit_m) * unit_m
    out = depth_filters.process(z, Strengths(nominal=camera, values={"speckle_filter": 60}))
    assert np.isfinite(out).all()


def test_range_includes_its_lower_end() -> None:
    z = np.array([[0.4, 0.5, 2.0, NAN]])
    assert np.isfinite(depth_filters.within(z, 0.5)).tolist() == [[False, True, True, False]]


def test_spatial_filter_reduces_noise_by_its_law() -> None:
    """Law: the variance of white noise scales by mean_w((a^2 / (1 + b^2 - 2 b cos w))^(2 n))^2."""
    noise = 20.0 + np.random.default_rng(0).normal(0, 0.01, (300, 300))
    alpha, times = 0.5, 2
    out = depth_filters.smooth_space(noise, alpha, 1.0, times)[50:-50, 50:-50]
    w, b = np.linspace(0, np.pi, 20001), 1 - alpha
    share = np.mean((alpha**2 / (1 + b**2 - 2 * b * np.cos(w))) ** (2 * times)) ** 2
    assert out.var() / noise.var() == pytest.approx(share, rel=0.1)


def test_spatial_filter_stops_at_jumps_and_holes() -> None:
    d = np.full((20, 20), 10.0)
    d[:, 10:] = 12.0
    d[7, 3] = NAN
    out = depth_filters.smooth_space(d, 0.3, 1.0, 3)
    np.testing.assert_allclose(out, d, equal_nan=True)


def test_filling_from_the_left() -> None:
    z = np.array([[NAN, 1.0, NAN, NAN, 2.0, NAN]])
    out = depth_filters.fill(z, depth_filters.LEFT)
    assert np.isnan(out[0, 0])
    assert out[0, 1:].tolist() == [1.0, 1.0, 1.0, 2.0, 2.0]


def test_filling_from_neighbours() -> None:
    """Filled pixels fill the next ones. Mode `NEAREST` fills only below depth."""
    z = np.array([[1.0, 3.0, NAN], [2.0, NAN, NAN], [4.0, 5.0, 6.0]])
    far = depth_filters.fill(z, depth_filters.FARTHEST)
    assert far[0, 2] == 3.0  # Left is 3; lower left and below are missing.
    assert far[1, 1] == 5.0
    assert far[1, 2] == 6.0
    near = depth_filters.fill(z, depth_filters.NEAREST)
    assert np.isnan(near[0, 2])
    assert near[1, 1] == 1.0
    assert np.isnan(near[1, 2])
    np.testing.assert_array_equal(depth_filters.fill(z, 0), z)
    assert np.isnan(depth_filters.fill(np.full((2, 2), NAN), depth_filters.FARTHEST)).all()


def test_units() -> None:
    z = np.array([[0.004, 0.0149, 1.0, 656.0, NAN]])
    out = depth_filters.in_units(z, 0.01)
    assert np.isnan(out[0, [0, 3, 4]]).all()
    assert out[0, 1:3] == pytest.approx([0.01, 1.0])


def test_spatial_filter_uses_disparity_and_the_defaults_of_librealsense(camera: Nominal) -> None:
    scale = camera.focal_baseline_px_m
    disparity = 20.0 + np.random.default_rng(0).normal(0, 0.6, (25, 33))
    half = Strengths(nominal=camera, values={"spatial_filter": 0.5})
    out = depth_filters.process(scale / disparity, half)
    np.testing.assert_allclose(scale / out, depth_filters.smooth_space(disparity, 0.5, 0.625, 2))
