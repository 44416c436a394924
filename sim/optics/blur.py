"""From radiance to the image on the imager: the lens."""

from __future__ import annotations

import cv2
import numpy as np

from sim.layers import Image


def blur(radiance: Image, sigma_px: float) -> Image:
    """Blur by the lens's Gaussian spot; 0 px is the identity, bit for bit.

    Args:
        radiance: (h, w) [W m^-2 sr^-1].
        sigma_px: standard deviation of the spot [px].
    """
    if sigma_px == 0:
        return radiance
    return np.asarray(
        cv2.GaussianBlur(radiance, (0, 0), sigma_px, borderType=cv2.BORDER_REFLECT_101), np.float32
    )
