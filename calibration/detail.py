"""High-pass filter and local variance of images: they keep dots and texture, not shading."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating[Any]]

NEIGHBOURHOOD_PX = 6.0  # Sigma of the subtracted local mean; covers several dots.
DEVIATION_PX = 10.0  # Sigma of the window of the local variance.


def mean(image: Array) -> Array:
    """Return the local mean (h, w), weighted by a Gaussian of sigma 6 px."""
    return np.asarray(cv2.GaussianBlur(image, (0, 0), NEIGHBOURHOOD_PX), image.dtype)


def high_passed(image: Array) -> Array:
    """Subtract the local mean (h, w)."""
    return image - mean(image)


def variance(detail: Array) -> Array:
    """Return the local mean square (h, w) of a high-passed image; Gaussian of sigma 10 px."""
    return np.asarray(cv2.GaussianBlur(detail * detail, (0, 0), DEVIATION_PX), detail.dtype)
