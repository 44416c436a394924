"""Point spread functions: exact variance for every shape, and conservation of light."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from starling.diagnosis.validation.camera import psf

SHAPES: tuple[psf.Shape, ...] = ("gaussian", "disc", "exponential")


@pytest.mark.parametrize("shape", SHAPES)
@given(sigma_px=st.floats(0.05, 4.0))
def test_kernels_have_their_variance(shape: psf.Shape, sigma_px: float) -> None:
    spot = psf.kernel(shape, sigma_px)
    assert spot.sum() == pytest.approx(1.0)
    assert psf.variance(spot) == pytest.approx(sigma_px**2, rel=1e-6)
    assert psf.variance(spot.T) == pytest.approx(sigma_px**2, rel=1e-6)


@pytest.mark.parametrize("step", [(0, 1), (1, 0), (1, 1), (1, -1)])
@given(sigma=st.floats(0.05, 4.0))
def test_a_line_kernel_has_its_variance_along_the_line_only(step: psf.Step, sigma: float) -> None:
    spot = psf.line(sigma, step)
    down, right = (np.arange(size) - size // 2 for size in spot.shape)
    assert spot.sum() == pytest.approx(1.0)
    moments = ((down**2, right**0), (down, right))
    covariance = [(spot * np.outer(*factors)).sum() for factors in moments]
    assert covariance[0] == pytest.approx(step[0] ** 2 * sigma**2, rel=1e-6)
    assert covariance[1] == pytest.approx(step[0] * step[1] * sigma**2, rel=1e-6)


def test_shapes_differ() -> None:
    """Kernels of equal variance differ at their centres."""
    centres = [psf.kernel(shape, 1.0).max() for shape in SHAPES]
    assert min(np.diff(sorted(centres))) > 0.01


def test_zero_width_returns_the_image_itself() -> None:
    image = np.random.default_rng(0).random((9, 11))
    assert psf.blur(image, psf.kernel("disc", 0.0)) is image
    assert psf.scatter(image, np.zeros(image.shape), "disc") is image
    inside = np.ones(image.shape, bool)
    assert psf.scatter_within(image, np.zeros(image.shape), "disc", inside) is image
    assert psf.scatter_within(image, np.ones(image.shape), "disc", ~inside) is image
    zero, positive = (
        np.stack([variance, variance, 0 * variance]) for variance in (0 * image, image)
    )
    assert psf.ellipses_within(image, zero, inside) is image
    assert psf.ellipses_within(image, positive, ~inside) is image


@given(sigma_px=st.floats(0.1, 2.0))
def test_varying_widths_are_exact_for_every_point(sigma_px: float) -> None:
    """Rationale: the mixture of two spots has the mixed variance, so no width is rounded."""
    widths = np.linspace(0.0, 2.0, 41)[None, :] * np.ones((41, 1))
    widths[20, 20] = sigma_px
    point = np.zeros((41, 41))
    point[20, 20] = 1.0
    out = psf.scatter(point, widths, "disc")
    assert out.sum() == pytest.approx(1.0)
    offset = np.arange(41) - 20
    assert (out.sum(0) * offset**2).sum() == pytest.approx(sigma_px**2, rel=1e-4)


@given(
    angle=st.floats(0, np.pi), across=st.floats(0.05, 2.0), stretch=st.floats(1.0, 2.4)
)  # fmt: skip
def test_ellipses_have_their_covariance(angle: float, across: float, stretch: float) -> None:
    """The tails are heavier than those of a Gaussian."""
    direction = np.array([np.cos(angle), np.sin(angle)])
    expected = across * (np.eye(2) + (stretch**2 - 1) * np.outer(direction, direction))
    even = np.ones((61, 61))
    spots = np.stack([expected[0, 0] * even, expected[1, 1] * even, expected[0, 1] * even])
    point = np.zeros((61, 61))
    point[30, 30] = 1.0
    out = psf.scatter_ellipses(point, spots)
    y, x = np.indices(out.shape) - 30
    moments = [(out * weight).sum() for weight in (x * x, y * y, x * y)]
    np.testing.assert_allclose(moments, [expected[0, 0], expected[1, 1], expected[0, 1]], atol=2e-3)
    assert (out * x**4).sum() > 3.2 * expected[0, 0] ** 2


def test_pixels_outside_a_region_do_not_affect_its_spots() -> None:
    """Rationale: spots of zero width outside would widen the range of mixed widths."""
    rng = np.random.default_rng(0)
    inside = np.zeros((40, 60), bool)
    inside[5:35, 8:40] = True
    inside[15:20, 20:25] = False
    variance = 1.0 + 0.2 * rng.random(inside.shape)
    image = np.where(inside, rng.random(inside.shape), 0.0)
    results = [
        psf.ellipses_within(image, np.stack([sigma2, sigma2, 0.1 * sigma2]), inside)
        for sigma2 in (
            variance,
            np.where(inside, variance, 0.0),
            np.where(inside, variance, 9.0),
        )
    ]
    np.testing.assert_array_equal(results[0], results[1])
    np.testing.assert_array_equal(results[0], results[2])


def test_spread_within_a_region_keeps_a_uniform_image() -> None:
    inside = np.zeros((20, 30), bool)
    inside[5:15, 8:20] = True
    out = psf.scatter_within(np.where(inside, 3.0, 7.0), np.full((20, 30), 2.0), "disc", inside)
    np.testing.assert_allclose(out[inside], 3.0)
    assert not out[~inside].any()


@given(sigma_px=st.floats(0.3, 2.5), share=st.floats(0, 0.6))
def test_a_halo_keeps_light_and_variance(sigma_px: float, share: float) -> None:
    point = np.zeros((101, 101))
    point[50, 50] = 1.0
    spot = psf.with_halo(point, sigma_px, share)
    assert spot.sum() == pytest.approx(1.0)
    assert psf.variance(spot) == pytest.approx(sigma_px**2, rel=1e-6)
    assert psf.variance(spot.T) == pytest.approx(sigma_px**2, rel=1e-6)


def test_a_halo_changes_the_shape_only_if_it_holds_light() -> None:
    point = np.zeros((101, 101))
    point[50, 50] = 1.0
    plain = psf.blur(point, psf.kernel("gaussian", 1.5))
    np.testing.assert_array_equal(psf.with_halo(point, 1.5, 0.0), plain)
    halo = psf.with_halo(point, 1.5, 0.2)
    assert halo[50, 50] > 1.1 * plain[50, 50] and halo[50, 57] > 2 * plain[50, 57]
