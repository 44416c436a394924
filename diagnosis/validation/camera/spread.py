"""Blur whose width differs from place to place: light is spread from where it comes from."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from starling.diagnosis.validation.camera import psf

_LEVELS = 6  # Widths between the narrowest and the widest spot.
_CORE_SHARE = 0.8  # Of a dot's added spot; the rest is a halo, as of a scratched or dirty lens.
_HALO_RATIO = 2.5  # Width of the halo over the core's.
Image = NDArray[np.float64]
Box = tuple[slice, slice]  # Rows and columns.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Ellipse:
    """Variances and covariance that spots have in each pixel, (h, w) [px^2]."""

    xx: Image
    yy: Image
    xy: Image

    def __getitem__(self, box: Box) -> Ellipse:
        return Ellipse(xx=self.xx[box], yy=self.yy[box], xy=self.xy[box])

    def where(self, inside: NDArray[np.bool_]) -> Ellipse:
        """The same spots there, elsewhere the smallest of these: no width is mixed in for it."""
        least = np.argmin(np.where(inside, self.xx + self.yy, np.inf))
        xx, yy, xy = (
            np.where(inside, one, one.ravel()[least]) for one in (self.xx, self.yy, self.xy)
        )
        return Ellipse(xx=xx, yy=yy, xy=xy)

    def times(self, factor: float) -> Ellipse:
        """The same spots, larger: variances by a factor."""
        return Ellipse(xx=factor * self.xx, yy=factor * self.yy, xy=factor * self.xy)


def scatter(
    image: NDArray[np.float64], sigma_px: NDArray[np.float64], shape: psf.Shape
) -> NDArray[np.float64]:
    """Spread the light of every pixel by a spot of its own width.

    The light of a pixel is shared out between the two nearest of a few widths so that variances are
    kept: a mixture of spots of variances a and b has the mixed variance, exactly.

    Args:
        image: Light (h, w).
        sigma_px: Root of the spot's variance along each axis (h, w), >= 0.
        shape: Shape of the spots.

    Returns:
        Light (h, w); the very image given where nothing is spread.
    """
    return _mixed(image, sigma_px, lambda width: psf.kernel(shape, width))


def scatter_ellipses(image: Image, spots: Ellipse) -> Image:
    """Spread the light of every pixel by a bright core and a halo, both longer one way.

    A covariance is the sum of variances along rows, columns and a diagonal, each of which a line of
    pixels has exactly; the first two are not below 0 where spots are less than 2.4 times as long as
    wide.

    Args:
        image: Light (h, w).
        spots: Of every pixel.
    """
    rest = 1.0 - _CORE_SHARE
    narrower = 1.0 / (_CORE_SHARE + rest * _HALO_RATIO**2)
    core = _gaussians(image, spots.times(narrower))
    halo = _gaussians(image, spots.times(narrower * _HALO_RATIO**2))
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
    """Spread as `scatter`, but within a region alone, what is even in it staying as it is.

    Args:
        image: Quantity (h, w), counted inside only.
        sigma_px: As in `scatter`.
        shape: Shape of the spots.
        inside: Region (h, w) that nothing leaves or enters.

    Returns:
        Quantity (h, w), 0 outside; the very image given where nothing is spread.
    """
    if not inside.any() or float(sigma_px[inside].max()) == 0.0:
        return image
    box = _box(inside)
    width = np.where(inside[box], sigma_px[box], sigma_px[inside].min())
    return _kept_within(image, inside, box, lambda light: scatter(light, width, shape))


def ellipses_within(image: Image, spots: Ellipse, inside: NDArray[np.bool_]) -> Image:
    """Spread as `scatter_ellipses`, likewise within a region alone (see `scatter_within`)."""
    if not inside.any() or float((spots.xx + spots.yy)[inside].max()) == 0.0:
        return image
    box = _box(inside)
    cut = spots[box].where(inside[box])
    return _kept_within(image, inside, box, lambda light: scatter_ellipses(light, cut))


def _box(inside: NDArray[np.bool_]) -> Box:
    rows, columns = np.nonzero(inside)
    return np.s_[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1]


def _kept_within(
    image: Image, inside: NDArray[np.bool_], box: Box, spread: Callable[[Image], Image]
) -> Image:
    weight = inside[box].astype(np.float64)
    found, even = spread(image[box] * weight), spread(weight)
    out = np.zeros_like(image)
    out[box] = np.where(inside[box], found / np.maximum(even, 1e-9), 0.0)
    return out
