"""Spots of light: kernels whose second moment is exact on the pixel grid.

The pages give every blur as the standard deviation of a Gaussian. Real spots are no Gaussians; what
adds up under convolution is the variance alone. So each blur here has a shape of its own and the
page's variance: a shape's width is solved until the variance of the *sampled* kernel is that of the
page, which a kernel merely sampled at the nominal width misses by a lot below one pixel.
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

_LEAST_PX = 1e-3  # Narrower spots move less than a millionth of the light.


@lru_cache(maxsize=256)
def kernel(shape: Shape, sigma_px: float) -> Kernel:
    """Make a spot of unit sum.

    Args:
        shape: `gaussian`, the integral of one over the pixels; `disc`, a defocused round aperture;
            `exponential`, what diffuses in a turbid body (Jensen et al. 2001, eq. 4, far from the
            source).
        sigma_px: Root of the variance along each axis [px].

    Returns:
        Kernel of odd side, read-only; its discrete variance is sigma_px^2 along both axes.
    """
    if sigma_px < _LEAST_PX:
        return _frozen(np.ones((1, 1)))
    radius = math.ceil(_REACH[shape] * sigma_px) + 1
    return _frozen(_of_variance(sigma_px, lambda width: _SHAPES[shape](width, radius)))


@lru_cache(maxsize=256)
def line(sigma: float, step: Step) -> Kernel:
    """Make a Gaussian along a line of pixels, of unit sum.

    Args:
        sigma: Root of its variance [steps].
        step: From one pixel to the next.

    Returns:
        Kernel of odd sides, read-only; its discrete variance along the line is sigma^2 steps^2.
    """
    if sigma < _LEAST_PX:
        return _frozen(np.ones((1, 1)))
    radius = math.ceil(_REACH["gaussian"] * sigma) + 1
    weights = _of_variance(sigma, lambda width: _gaussian_line(width, radius)[None])[0]
    down, right = step
    spot = np.zeros((2 * radius * abs(down) + 1, 2 * radius * abs(right) + 1))
    place = np.arange(-radius, radius + 1)
    spot[radius * abs(down) + place * down, radius * abs(right) + place * right] = weights
    return _frozen(spot)


def _of_variance(sigma: float, build: Callable[[float], Kernel]) -> Kernel:
    """A kernel as wide as its variance asks."""
    width = brentq(lambda width: variance(build(width)) - sigma**2, 1e-9, 4 * sigma + 1, xtol=1e-12)
    assert isinstance(width, float)
    return build(width)


def variance(spot: Kernel) -> float:
    """Variance of a kernel along x [px^2]; those of this file have the same along y."""
    across = np.arange(spot.shape[1]) - spot.shape[1] // 2
    return float((spot.sum(0) * across**2).sum())


def blur(image: NDArray[np.float64], spot: Kernel) -> NDArray[np.float64]:
    """Convolve an image (h, w) with a spot; beyond the border the image is mirrored."""
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
    """A disc of radius `width`; a pixel on its rim is covered in proportion to its distance."""
    covered = np.clip(width - _distance(radius) + 0.5, 0.0, 1.0)
    return covered / covered.sum()


def _exponential(width: float, radius: int) -> Kernel:
    spread = np.exp(-_distance(radius) / width)
    return spread / spread.sum()


def _distance(radius: int) -> NDArray[np.float64]:
    line = np.arange(-radius, radius + 1.0)
    return np.hypot(line[None, :], line[:, None])


def _frozen(spot: Kernel) -> Kernel:
    spot.setflags(write=False)
    return spot


_SHAPES: dict[Shape, Callable[[float, int], Kernel]] = {
    "gaussian": _gaussian,
    "disc": _disc,
    "exponential": _exponential,
}
# Where the kernel is cut, in standard deviations.
_REACH: dict[Shape, float] = {
    "gaussian": 4.5,
    "disc": 2.2,
    "exponential": 5.0,
}
