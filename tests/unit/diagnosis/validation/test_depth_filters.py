"""Effects on matched depth."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

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


def _map(seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    d = 20.0 + rng.normal(0, 0.3, (24, 30))
    d[rng.random(d.shape) < 0.1] = NAN
    return d


@pytest.mark.parametrize(
    "refine",
    [
        lambda d: depth_filters.median(d, 0),
        lambda d: depth_filters.lock(d, 0.0),
        lambda d: depth_filters.steps(d, 0.0),
        lambda d: depth_filters.without_islands(d, 0, 1.0),
    ],
)
def test_no_refinement_returns_the_map_itself(refine) -> None:
    d = _map()
    assert refine(d) is d


@pytest.mark.parametrize("side", [3, 5])
def test_median_is_of_the_valid_neighbours(side: int) -> None:
    d = _map()
    out = depth_filters.median(d, side)
    np.testing.assert_array_equal(np.isnan(out), np.isnan(d))
    padded = np.pad(d, side // 2, constant_values=NAN)
    for row, column in ((0, 0), (10, 12), (23, 29)):
        if np.isfinite(d[row, column]):
            window = padded[row : row + side, column : column + side]
            assert out[row, column] == pytest.approx(np.nanmedian(window))


@given(amplitude=st.floats(-0.15, 0.15))
def test_locking_is_a_sine_of_the_fraction(amplitude: float) -> None:
    d = np.linspace(10.0, 12.0, 201)[None]
    error = depth_filters.lock(d, amplitude) - d
    np.testing.assert_allclose(error, -amplitude * np.sin(2 * np.pi * d), atol=1e-12)


def test_steps() -> None:
    out = depth_filters.steps(np.array([[1.1, 1.13, NAN]]), 0.25)
    assert out[0, :2].tolist() == [1.0, 1.25]
    assert np.isnan(out[0, 2])


def test_islands_by_count() -> None:
    """Islands of at most `count` pixels are removed. Steps above the limit separate islands."""
    d = np.full((10, 30), NAN)
    d[2:4, 2:5] = 7.0  # Six pixels.
    d[2:4, 10:17] = 7.0
    d[2, 10] = 20.0  # One pixel at another disparity, so that 13 remain.
    out = depth_filters.without_islands(d, 6, 1.0)
    assert np.isnan(out[2:4, 2:5]).all()
    assert np.isnan(out[2, 10])
    assert np.isfinite(out).sum() == 13
    assert np.isfinite(depth_filters.without_islands(d, 5, 1.0)).sum() == 19


def test_rounded_depth_does_not_separate_islands() -> None:
    """A staircase of 1 px steps stays one island after rounding of depth to millimetres.

    Steps wider than the rounding error still separate islands.
    """
    fb, unit_m = 10.6, 0.001
    stairs = np.repeat(np.arange(10.0, 50.0), 3)[None] + np.linspace(0.0, 0.9, 7)[:, None]
    rounded = fb / (np.rint(fb / stairs / unit_m) * unit_m)
    assert (np.abs(np.diff(rounded, axis=1)) > 1.0).any()
    half_unit = 0.5 * unit_m / fb
    out = depth_filters.without_islands(rounded, 100, 1.0, half_unit_per_px=half_unit)
    assert np.isfinite(out).all()
    wide = np.where(stairs < 30.0, rounded, fb / (fb / rounded - 0.003))  # Three units nearer.
    out = depth_filters.without_islands(wide, stairs.size - 1, 1.0, half_unit_per_px=half_unit)
    assert np.isnan(out).all()
