"""The lens's spot, even over the image: a Gaussian."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import special

from starling.sim.render.layers import Image


def kernel(variance_px2: float) -> NDArray[np.float32]:
    """Gaussian for pixels: weights exp(-t) I_n(t) of variance t exactly, summing to 1.

    A Gaussian that is merely sampled is too narrow below a pixel (by a fifth in variance at sigma
    0.5 px), and two in a row do not make the third; this one has both properties for every t.

    Args:
        variance_px2: t [px^2], >= 0.

    Returns:
        (2 n + 1,) weights; n is 4 sigma + 1, which leaves out 0.1 % of the variance.

    Source: Lindeberg, IEEE TPAMI 12(3), 1990, "Scale-space for discrete signals", eq. 19.
    """
    reach = int(np.ceil(4 * np.sqrt(variance_px2))) + 1
    weights = special.ive(np.abs(np.arange(-reach, reach + 1)), variance_px2)
    return (weights / weights.sum()).astype(np.float32)


def spread(radiance: Image, variance_px2: float, into: Image | None = None) -> Image:
    """Blur by a Gaussian of this variance [px^2]; light that leaves is mirrored back in.

    Args:
        radiance: (h, w) [W m^-2 sr^-1].
        variance_px2: of the spot on each axis [px^2].
        into: where the result goes, if not into a new image.
    """
    weights = kernel(variance_px2)
    blurred = cv2.sepFilter2D(
        radiance, cv2.CV_32F, weights, weights, dst=into, borderType=cv2.BORDER_REFLECT
    )
    return np.asarray(blurred, np.float32)


def blur(radiance: Image, sigma_px: float) -> Image:
    """Blur by the lens's Gaussian spot; 0 px is the identity, bit for bit.

    Args:
        radiance: (h, w) [W m^-2 sr^-1].
        sigma_px: standard deviation of the spot [px].
    """
    if sigma_px == 0:
        return radiance
    return spread(radiance, sigma_px**2)
