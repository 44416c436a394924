"""Shapes of the lens's spot: light, width and kurtosis, and their limits."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from starling.patterns.errors import InputError
from starling.sim.imaging.optics import spot, spot_shapes
from starling.sim.sensor.sensor import Lens
from tests.unit.sim.test_optics import PINHOLE, SHAPE, moments, point, texture

SIGMA = st.floats(0.05, 3.0)
SPOT_SHAPE = st.floats(-1.0, 1.0)


def kurtosis(kernel: np.ndarray) -> float:
    """Excess kurtosis along rows."""
    place = np.arange(kernel.shape[1]) - kernel.shape[1] // 2
    line = kernel.sum(axis=0, dtype=float)
    return float(line @ place**4 / (line @ place**2) ** 2 - 3)


@given(SIGMA, SPOT_SHAPE)
def test_a_point_is_as_wide_as_set_in_every_shape(sigma: float, shape: float) -> None:
    """Light to 1e-5 and second moment to 1 % in every shape; no weight is negative."""
    seen = spot.blur(point(80, 60), sigma, shape=shape)
    assert seen.sum(dtype=float) == pytest.approx(1, rel=1e-5) and seen.min() > -1e-12
    assert moments(seen)[2:] == pytest.approx((sigma**2, sigma**2), rel=0.01)


@pytest.mark.parametrize(("shape", "wanted"), [(-1.0, -1.0), (-0.5, -0.5), (0.5, 1.0), (1.0, 2.0)])
def test_kurtosis_is_that_of_the_continuous_spot(shape: float, wanted: float) -> None:
    """By hand: disc -1, exponential tails 2; a mixture of equal variance has the mean."""
    kernel = spot_shapes.mixed(spot.kernel(36.0), 36.0, shape)
    assert kurtosis(kernel) == pytest.approx(wanted, abs=0.05)


def test_a_wide_disc_is_flat_and_ends_at_two_sigma() -> None:
    disc = spot_shapes.disc(25.0)
    middle = len(disc) // 2
    rows, columns = np.indices(disc.shape) - middle
    far = np.hypot(rows, columns)
    assert np.ptp(disc[far < 9]) < 1e-12 and not disc[far > 11].any()
    assert disc[middle, middle] == pytest.approx(1 / (np.pi * 10**2), rel=0.02)


def test_tails_fall_exponentially() -> None:
    """Along a row, beyond a sigma: log light falls by 1 / a a pixel, a = sigma / sqrt(3)."""
    tails = spot_shapes.tails(36.0)
    row = tails[len(tails) // 2, len(tails) // 2 :]
    slope = np.diff(np.log(row[6:30]))
    np.testing.assert_allclose(slope, -np.sqrt(3) / 6, rtol=0.02)


@given(st.floats(-1.0, 1.0).filter(lambda shape: abs(shape) > 1e-3))
def test_shapes_hold_in_corners_and_out_of_focus(shape: float) -> None:
    """The blurred square of the distance is a pixel's second moment; a fourth power its shape."""
    lens = Lens(blur_px=0.5, corner_blur_px=1.5, defocus_px_m=2.0, focus_m=1.0, spot_shape=shape)
    depth_m = np.full(SHAPE, 0.6, np.float32)
    wanted = spot.variance(depth_m, lens, PINHOLE)[51, 70]
    square = (np.indices(SHAPE, np.float32)[1] - 70) ** 2
    (seen,) = spot.blur_by_spot((square,), depth_m, lens, PINHOLE)
    assert seen[51, 70] == pytest.approx(wanted, rel=0.02)


def test_a_gaussian_spot_is_that_without_a_shape() -> None:
    """Bit for bit, also where the variance differs between pixels."""
    depth_m = np.full(SHAPE, 0.6, np.float32)
    lens = Lens(blur_px=0.7, corner_blur_px=1.0, defocus_px_m=0.5)
    neutral = dataclasses.replace(lens, spot_shape=0.0)
    for each in (Lens(blur_px=0.7), lens, neutral):
        (seen,) = spot.blur_by_spot((texture(),), depth_m, each, PINHOLE)
        if each.corner_blur_px == 0:
            assert np.array_equal(seen, spot.blur(texture(), 0.7))
    assert lens == neutral


def test_a_sharp_lens_has_no_shape() -> None:
    light = texture()
    depth_m = np.full(SHAPE, 1.0, np.float32)
    (seen,) = spot.blur_by_spot((light,), depth_m, Lens(spot_shape=-1.0), PINHOLE)
    assert seen is light
    focused = Lens(spot_shape=1.0, defocus_px_m=0.5, focus_m=1.0)
    (seen,) = spot.blur_by_spot((light,), depth_m, focused, PINHOLE)
    np.testing.assert_allclose(seen, light, atol=1e-6)


@pytest.mark.parametrize("shape", [-1.1, 1.1, float("nan")])
def test_a_shape_beyond_the_ends_is_refused(shape: float) -> None:
    with pytest.raises(InputError, match=r"^lens.spot_shape must be in \[-1, 1\]; got"):
        Lens(spot_shape=shape)
