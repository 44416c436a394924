"""Point spread functions whose variance is exact on the pixel grid.

The effect pages define every blur as the standard deviation of a Gaussian. Real spots are not
Gaussian, and only variances add under convolution. Each blur here has its own shape and the
variance of the page. The width of the shape is solved for the variance of the *sampled* kernel. A
kernel sampled at the nominal width is far off below one pixel.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import erf

Shape = Literal["gaussian", "disc", "exponential"]
Step = tuple[int, int]  # Rows and columns from one pixel of a line to the next.
Kernel = NDArray[np.float64]

_LEAST_PX = 1e-3  # Narrower spots move less than a millionth of the light [px].


@lru_cache(maxsize=256)
def kernel(shape: Shape, sigma_px: float) -> Kernel:
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
    radius = math.ceil(_REACH[shape] * sigma_px) + 1
    return _read_only(_solve_width(sigma_px, lambda width: _SHAPES[shape](width, radius)))


@lru_cache(maxsize=256)
def line(sigma: float, step: Step) -> Kernel:
    """Build a Gaussian along a line of pixels, of unit sum.

    Args:
        sigma: Standard deviation [steps].
        step: Rows and columns from one pixel of the line to the next.

    Returns:
        Read-only kernel of odd sides. Its discrete variance along the line is sigma^2 steps^2.
    """
    if sigma < _LEAST_PX:
        return _read_only(np.ones((1, 1)))
    radius = math.ceil(_REACH["gaussian"] * sigma) + 1
    weights = _solve_width(sigma, lambda width: _gaussian_line(width, radius)[None])[0]
    down, right = step
    spot = np.zeros((2 * radius * abs(down) + 1, 2 * radius * abs(right) + 1))
    place = np.arange(-radius, radius + 1)
    spot[radius * abs(down) + place * down, radius * abs(right) + place * right] = weights
    return _read_only(spot)


def _solve_width(sigma: float, build: Callable[[float], Kernel]) -> Kernel:
    """Build the kernel whose width gives the variance sigma^2."""
    width = brentq(lambda width: variance(build(width)) - sigma**2, 1e-9, 4 * sigma + 1, xtol=1e-12)
    assert isinstance(width, float)
    return build(width)


def variance(spot: Kernel) -> float:
    """Return the variance of a kernel along x [px^2]; kernels here have the same along y."""
    across = np.arange(spot.shape[1]) - spot.shape[1] // 2
    return float((spot.sum(0) * across**2).sum())


def blur(image: NDArray[np.float64], spot: Kernel) -> NDArray[np.float64]:
    """Convolve an image (h, w) with a spot. The image is mirrored at the border."""
    if spot.size == 1:
        return image
    blurred = cv2.filter2D(image, cv2.CV_64F, spot, borderType=cv2.BORDER_REFLECT_101)
    return np.asarray(blurred, np.float64)


def _gaussian(width: float, radius: int) -> Kernel:
    line = _gaussian_line(width, radius)
    return line[:, None] * line[None, :]


def _gaussian_line(width: float, radius: int) -> NDArray[np.float64]:
    edges = np.arange(-radius - 0.5, radius + 1.0)
    line = np.diff(erf(edges / (math.sqrt(2.0) * width)))
    return line / line.sum()


def _disc(width: float, radius: int) -> Kernel:
    """Build a disc of radius `width`. Coverage of rim pixels is linear in their distance."""
    covered = np.clip(width - _distance(radius) + 0.5, 0.0, 1.0)
    return covered / covered.sum()


def _exponential(width: float, radius: int) -> Kernel:
    spread = np.exp(-_distance(radius) / width)
    return spread / spread.sum()


def _distance(radius: int) -> NDArray[np.float64]:
    line = np.arange(-radius, radius + 1.0)
    return np.hypot(line[None, :], line[:, None])


def _read_only(spot: Kernel) -> Kernel:
    spot.setflags(write=False)
    return spot


_SHAPES: dict[Shape, Callable[[float, int], Kernel]] = {
    "gaussian": _gaussian,
    "disc": _disc,
    "exponential": _exponential,
}
# Radius at which the kernel is truncated [standard deviations].
_REACH: dict[Shape, float] = {
    "gaussian": 4.5,
    "disc": 2.2,
    "exponential": 5.0,
}
