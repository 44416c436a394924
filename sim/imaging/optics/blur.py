"""The lens's spot if it is uniform over the image: a Gaussian."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import special

from starling.sim.arrays import Image


def kernel(variance_px2: float) -> NDArray[np.float32]:
    """Return the discrete Gaussian exp(-t) I_n(t), with variance t and sum 1.

    A sampled Gaussian is too narrow below a pixel, by a fifth in variance at sigma 0.5 px. Nor do
    two in a row equal one with the summed variance. The discrete Gaussian has the right variance
    and this semigroup property for every t.

    Args:
        variance_px2: t [px^2], >= 0.

    Returns:
        (2 n + 1,) weights; n is 4 sigma + 1, which truncates 0.1 % of the variance.

    Source: Lindeberg, IEEE TPAMI 12(3), 1990, "Scale-space for discrete signals", eq. 19.
    """
    reach = int(np.ceil(4 * np.sqrt(variance_px2))) + 1
    weights = special.ive(np.abs(np.arange(-reach, reach + 1)), variance_px2)
    return (weights / weights.sum()).astype(np.float32)


def spread(radiance: Image, variance_px2: float, into: Image | None = None) -> Image:
    """Blur with a Gaussian of this variance [px^2]; the image is mirrored at its border.

    Args:
        radiance: (h, w) [W m^-2 sr^-1].
        variance_px2: variance of the spot on each axis [px^2].
        into: array for the result; None allocates one.
    """
    weights = kernel(variance_px2)
    blurred = cv2.sepFilter2D(
        radiance, cv2.CV_32F, weights, weights, dst=into, borderType=cv2.BORDER_REFLECT
    )
    return np.asarray(blurred, np.float32)


def blur(radiance: Image, sigma_px: float) -> Image:
    """Blur with the lens's Gaussian spot; 0 px is the identity, bit for bit.

    Args:
        radiance: (h, w) [W m^-2 sr^-1].
        sigma_px: standard deviation of the spot [px].
    """
    if sigma_px == 0:
        return radiance
    return spread(radiance, sigma_px**2)
