"""Spatially varying blur: each source pixel spreads its light by a spot of its own width."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from starling.diagnosis.validation.camera import psf

_LEVELS = 6  # Number of widths from the narrowest to the widest spot.
_CORE_SHARE = 0.8  # Light in the core of a dot's added spot; the rest is the halo of a dirty lens.
_HALO_RATIO = 2.5  # Width of the halo over the width of the core.
Image = NDArray[np.float64]
Box = tuple[slice, slice]  # Rows and columns.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Ellipse:
    """Variances and covariance of the spot of each pixel, (h, w) [px^2]."""

    xx: Image
    yy: Image
    xy: Image

    def __getitem__(self, box: Box) -> Ellipse:
        return Ellipse(xx=self.xx[box], yy=self.yy[box], xy=self.xy[box])

    def where(self, inside: NDArray[np.bool_]) -> Ellipse:
        """Replace the spots outside by the smallest spot inside; the range of widths is kept."""
        least = np.argmin(np.where(inside, self.xx + self.yy, np.inf))
        xx, yy, xy = (
            np.where(inside, moment, moment.ravel()[least])
            for moment in (self.xx, self.yy, self.xy)
        )
        return Ellipse(xx=xx, yy=yy, xy=xy)

    def scaled(self, factor: float) -> Ellipse:
        """Multiply all variances by a factor."""
        return Ellipse(xx=factor * self.xx, yy=factor * self.yy, xy=factor * self.xy)


def scatter(
    image: NDArray[np.float64], sigma_px: NDArray[np.float64], shape: psf.Shape
) -> NDArray[np.float64]:
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
    return _mixed(image, sigma_px, lambda width: psf.kernel(shape, width))


def scatter_ellipses(image: Image, spots: Ellipse) -> Image:
    """Spread the light of every pixel by an elliptic spot with a bright core and a halo.

    A covariance is a sum of variances along rows, columns and a diagonal. A line kernel has each of
    these variances exactly. The first two are >= 0 for spots up to 2.4 times as long as wide.

    Args:
        image: Light (h, w).
        spots: Spot of every pixel.
    """
    rest = 1.0 - _CORE_SHARE
    narrower = 1.0 / (_CORE_SHARE + rest * _HALO_RATIO**2)
    core = _gaussians(image, spots.scaled(narrower))
    halo = _gaussians(image, spots.scaled(narrower * _HALO_RATIO**2))
    return _CORE_SHARE * core + rest * halo


def _gaussians(image: Image, spots: Ellipse) -> Image:
    diagonal = np.abs(spots.xy)
    lines: dict[psf.Step, Image] = {
        (0, 1): spots.xx - diagonal,
        (1, 0): spots.yy - diagonal,
        (1, 1): spots.xy,
        (1, -1): -spots.xy,
    }
    for step, variance in lines.items():
        sigma = np.sqrt(np.maximum(variance, 0.0))
        image = _mixed(image, sigma, lambda width, step=step: psf.line(width, step))
    return image


def _mixed(image: Image, sigma: Image, spot: Callable[[float], psf.Kernel]) -> Image:
    narrowest, widest = float(sigma.min()), float(sigma.max())
    if widest - narrowest <= 1e-6 * widest:
        return psf.blur(image, spot(widest))
    widths = np.linspace(narrowest, widest, _LEVELS)
    place = np.interp(sigma**2, widths**2, np.arange(_LEVELS))
    out = np.zeros_like(image)
    for level, width in enumerate(widths):
        share = np.clip(1.0 - np.abs(place - level), 0.0, None)
        out += psf.blur(image * share, spot(float(width)))
    return out


def scatter_within(
    image: NDArray[np.float64],
    sigma_px: NDArray[np.float64],
    shape: psf.Shape,
    inside: NDArray[np.bool_],
) -> NDArray[np.float64]:
    """Spread as `scatter` does, but only within a region. A uniform image stays uniform there.

    Args:
        image: Quantity (h, w). Values outside the region are ignored.
        sigma_px: Standard deviation of the spots (h, w), >= 0 [px].
        shape: Shape of the spots.
        inside: Region (h, w).

    Returns:
        Quantity (h, w), 0 outside, or `image` itself if all widths are 0.
    """
    if not inside.any() or float(sigma_px[inside].max()) == 0.0:
        return image
    box = _box(inside)
    width = np.where(inside[box], sigma_px[box], sigma_px[inside].min())
    return _normalised_within(image, inside, box, lambda light: scatter(light, width, shape))


def ellipses_within(image: Image, spots: Ellipse, inside: NDArray[np.bool_]) -> Image:
    """Spread as `scatter_ellipses` does, but only within a region (see `scatter_within`)."""
    if not inside.any() or float((spots.xx + spots.yy)[inside].max()) == 0.0:
        return image
    box = _box(inside)
    cut = spots[box].where(inside[box])
    return _normalised_within(image, inside, box, lambda light: scatter_ellipses(light, cut))


def _box(inside: NDArray[np.bool_]) -> Box:
    rows, columns = np.nonzero(inside)
    return np.s_[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1]


def _normalised_within(
    image: Image, inside: NDArray[np.bool_], box: Box, spread: Callable[[Image], Image]
) -> Image:
    weight = inside[box].astype(np.float64)
    spread_image, spread_weight = spread(image[box] * weight), spread(weight)
    out = np.zeros_like(image)
    out[box] = np.where(inside[box], spread_image / np.maximum(spread_weight, 1e-9), 0.0)
    return out
