"""Point spread functions with exact variance on the pixel grid, uniform or varying over the image.

The effect pages define every blur as the standard deviation of a Gaussian. Real spots are not
Gaussian, and only variances add under convolution. Each blur here has its own shape and the
variance of the page. The width of the shape is solved for the variance of the *sampled* kernel. A
kernel sampled at the nominal width is far off below one pixel.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache, partial
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import erf

Shape = Literal["gaussian", "disc", "exponential"]
Step = tuple[int, int]  # Rows and columns from one pixel of a line to the next.
Image = NDArray[np.float64]
Mask = NDArray[np.bool_]
Moments = Image  # (3, h, w): variances along x and y, and covariance of each pixel's spot [px^2].

_LEAST_PX = 1e-3  # Narrower spots move less than a millionth of the light [px].
_LEVELS = 6  # Number of widths from the narrowest to the widest spot.
_CORE_SHARE = 0.8  # Light in the core of a dot's added spot; the rest is the halo of a dirty lens.
_HALO_RATIO = 2.5  # Width of the halo over the width of the core.


@lru_cache(maxsize=256)
def kernel(shape: Shape, sigma_px: float) -> Image:
    """Build a spot of unit sum.

    Args:
        shape: Name of the shape. A `gaussian` is integrated over pixels. A `disc` is the spot of a
            defocused round aperture. An `exponential` is diffuse light in a turbid body far from
            the source (Jensen et al. 2001, eq. 4).
        sigma_px: Standard deviation along each axis [px].

    Returns:
        Read-only kernel of odd side. Its discrete variance is sigma_px^2 along both axes.
    """
    if sigma_px < _LEAST_PX:
        return _read_only(np.ones((1, 1)))
    build, reach = _SHAPES[shape]
    radius = math.ceil(reach * sigma_px) + 1
    return _read_only(_solve_width(sigma_px, lambda width: build(width, radius)))


@lru_cache(maxsize=256)
def line(sigma: float, step: Step) -> Image:
    """Build a Gaussian along a line of pixels, of unit sum.

    Args:
        sigma: Standard deviation [steps].
        step: Rows and columns from one pixel of the line to the next.

    Returns:
        Read-only kernel of odd sides. Its discrete variance along the line is sigma^2 steps^2.
    """
    if sigma < _LEAST_PX:
        return _read_only(np.ones((1, 1)))
    radius = math.ceil(_SHAPES["gaussian"][1] * sigma) + 1
    weights = _solve_width(sigma, lambda width: _gaussian_line(width, radius)[None])[0]
    down, right = step
    spot = np.zeros((2 * radius * abs(down) + 1, 2 * radius * abs(right) + 1))
    place = np.arange(-radius, radius + 1)
    spot[radius * abs(down) + place * down, radius * abs(right) + place * right] = weights
    return _read_only(spot)


def _solve_width(sigma: float, build: Callable[[float], Image]) -> Image:
    """Build the kernel whose width gives the variance sigma^2."""
    width = brentq(lambda width: variance(build(width)) - sigma**2, 1e-9, 4 * sigma + 1, xtol=1e-12)
    assert isinstance(width, float)
    return build(width)


def variance(spot: Image) -> float:
    """Return the variance of a kernel along x [px^2]; kernels here have the same along y."""
    across = np.arange(spot.shape[1]) - spot.shape[1] // 2
    return float((spot.sum(0) * across**2).sum())


def blur(image: Image, spot: Image) -> Image:
    """Convolve an image (h, w) with a spot. The image is mirrored at the border."""
    if spot.size == 1:
        return image
    blurred = cv2.filter2D(image, cv2.CV_64F, spot, borderType=cv2.BORDER_REFLECT_101)
    return np.asarray(blurred, np.float64)


def _gaussian(width: float, radius: int) -> Image:
    line = _gaussian_line(width, radius)
    return line[:, None] * line[None, :]


def _gaussian_line(width: float, radius: int) -> Image:
    edges = np.arange(-radius - 0.5, radius + 1.0)
    line = np.diff(erf(edges / (math.sqrt(2.0) * width)))
    return line / line.sum()


def _disc(width: float, radius: int) -> Image:
    """Build a disc of radius `width`. Coverage of rim pixels is linear in their distance."""
    covered = np.clip(width - _distance(radius) + 0.5, 0.0, 1.0)
    return covered / covered.sum()


def _exponential(width: float, radius: int) -> Image:
    spread = np.exp(-_distance(radius) / width)
    return spread / spread.sum()


def _distance(radius: int) -> Image:
    line = np.arange(-radius, radius + 1.0)
    return np.hypot(line[None, :], line[:, None])


def _read_only(spot: Image) -> Image:
    spot.setflags(write=False)
    return spot


def scatter(image: Image, sigma_px: Image, shape: Shape) -> Image:
    """Spread the light of every pixel by a spot of its own width.

    The light of a pixel is divided between the two nearest of a few widths. The mixture of two
    spots has exactly the mixed variance, so the variance of every pixel is exact.

    Args:
        image: Light (h, w).
        sigma_px: Standard deviation of the spot along each axis (h, w), >= 0 [px].
        shape: Shape of the spots.

    Returns:
        Light (h, w), or `image` itself if all widths are 0.
    """
    return _mixed(image, sigma_px, lambda width: kernel(shape, width))


def with_halo(image: Image, sigma_px: float, share: float) -> Image:
    """Blur an image (h, w) by a Gaussian core and a wider Gaussian halo.

    Args:
        image: Light.
        sigma_px: Standard deviation of the whole spot along each axis [px].
        share: Share of the light in the halo, 0 to 1.
    """
    core_px = sigma_px / math.sqrt(1.0 - share + share * _HALO_RATIO**2)
    core = blur(image, kernel("gaussian", core_px))
    if share == 0.0:
        return core
    return (1.0 - share) * core + share * blur(image, kernel("gaussian", _HALO_RATIO * core_px))


def scatter_ellipses(image: Image, spots: Moments) -> Image:
    """Spread the light of every pixel by an elliptic spot with a bright core and a halo.

    A covariance is a sum of variances along rows, columns and a diagonal. A line kernel has each of
    these variances exactly. The first two are >= 0 for spots up to 2.4 times as long as wide.

    Args:
        image: Light (h, w).
        spots: Spot of every pixel.
    """
    rest = 1.0 - _CORE_SHARE
    narrower = 1.0 / (_CORE_SHARE + rest * _HALO_RATIO**2)
    core = _gaussians(image, narrower * spots)
    halo = _gaussians(image, narrower * _HALO_RATIO**2 * spots)
    return _CORE_SHARE * core + rest * halo


def _gaussians(image: Image, spots: Moments) -> Image:
    xx, yy, xy = spots
    diagonal = np.abs(xy)
    for step, variance in (
        ((0, 1), xx - diagonal),
        ((1, 0), yy - diagonal),
        ((1, 1), xy),
        ((1, -1), -xy),
    ):
        image = _mixed(image, np.sqrt(np.maximum(variance, 0.0)), partial(line, step=step))
    return image


def _mixed(image: Image, sigma: Image, spot: Callable[[float], Image]) -> Image:
    narrowest, widest = float(sigma.min()), float(sigma.max())
    if widest - narrowest <= 1e-6 * widest:
        return blur(image, spot(widest))
    widths = np.linspace(narrowest, widest, _LEVELS)
    place = np.interp(sigma**2, widths**2, np.arange(_LEVELS))
    out = np.zeros_like(image)
    for level, width in enumerate(widths):
        share = np.clip(1.0 - np.abs(place - level), 0.0, None)
        out += blur(image * share, spot(float(width)))
    return out


def scatter_within(image: Image, sigma_px: Image, shape: Shape, inside: Mask) -> Image:
    """Spread as `scatter` does, but only within a region. A uniform image stays uniform there.

    Args:
        image: Quantity (h, w). Values outside the region are ignored.
        sigma_px: Standard deviation of the spots (h, w), >= 0 [px].
        shape: Shape of the spots.
        inside: Region (h, w).

    Returns:
        Quantity (h, w), 0 outside, or `image` itself if all widths are 0.
    """
    return _within(image, sigma_px[None], inside, lambda light, cut: scatter(light, cut[0], shape))


def ellipses_within(image: Image, spots: Moments, inside: Mask) -> Image:
    """Spread as `scatter_ellipses` does, but only within a region (see `scatter_within`)."""
    return _within(image, spots, inside, scatter_ellipses)


def _within(
    image: Image, spots: Image, inside: Mask, spread: Callable[[Image, Image], Image]
) -> Image:
    """Spread the normalised light of a region.

    Spots outside get the smallest spot inside, which keeps the range of widths.
    """
    size = np.where(inside, spots[:2].sum(0), np.inf)
    if not inside.any() or float(size[inside].max()) == 0.0:
        return image
    smallest = spots.reshape(len(spots), -1)[:, np.argmin(size)]
    rows, columns = np.nonzero(inside)
    box = np.s_[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1]
    region = inside[box]
    cut = np.where(region, spots[:, *box], smallest[:, None, None])
    weight = region.astype(np.float64)
    light = spread(image[box] * weight, cut) / np.maximum(spread(weight, cut), 1e-9)
    out = np.zeros_like(image)
    out[box] = np.where(region, light, 0.0)
    return out


# Each shape, and the radius at which its kernel is truncated [standard deviations].
_SHAPES: dict[Shape, tuple[Callable[[float, int], Image], float]] = {
    "gaussian": (_gaussian, 4.5),
    "disc": (_disc, 2.2),
    "exponential": (_exponential, 5.0),
}
