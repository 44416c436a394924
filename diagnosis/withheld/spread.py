"""Blur whose width differs from place to place: light is spread from where it comes from."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from diagnosis.withheld import psf

_LEVELS = 6  # Widths between the narrowest and the widest spot.


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
    narrowest, widest = float(sigma_px.min()), float(sigma_px.max())
    if widest == 0.0:
        return image
    if widest - narrowest < 1e-6 * widest:
        return psf.blur(image, psf.kernel(shape, widest))
    widths = np.linspace(narrowest, widest, _LEVELS)
    place = np.interp(sigma_px**2, widths**2, np.arange(_LEVELS))
    out = np.zeros_like(image)
    for level, width in enumerate(widths):
        share = np.clip(1.0 - np.abs(place - level), 0.0, None)
        out += psf.blur(image * share, psf.kernel(shape, float(width)))
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
    rows, columns = np.nonzero(inside)
    box = np.s_[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1]
    weight = inside[box].astype(np.float64)
    width = np.where(inside[box], sigma_px[box], sigma_px[inside].min())
    spread = scatter(image[box] * weight, width, shape)
    even = scatter(weight, width, shape)
    out = np.zeros_like(image)
    out[box] = np.where(inside[box], spread / np.maximum(even, 1e-9), 0.0)
    return out
