"""What of an image varies about its surroundings, and how much: dots and texture, no shading."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating[Any]]

NEIGHBOURHOOD_PX = 6.0  # Sigma of the mean that is subtracted: several dots wide.
DEVIATION_PX = 10.0  # Sigma of the neighbourhood that the deviation is taken over.


def mean(image: Array) -> Array:
    """Mean (h, w) of each pixel's neighbourhood, a Gaussian of sigma 6 px."""
    return np.asarray(cv2.GaussianBlur(image, (0, 0), NEIGHBOURHOOD_PX), image.dtype)


def high_passed(image: Array) -> Array:
    """Subtract the neighbourhood's mean (h, w)."""
    return image - mean(image)


def variance(detail: Array) -> Array:
    """Mean square (h, w) of what `high_passed` left, about each pixel, a Gaussian of 10 px."""
    return np.asarray(cv2.GaussianBlur(detail * detail, (0, 0), DEVIATION_PX), detail.dtype)
