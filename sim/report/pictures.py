"""Pictures of reports as arrays: size, grey scale and enlarged parts."""

from __future__ import annotations

from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

PANEL_PX = 640  # Maximum width of a picture.
ZOOM = 3  # Enlargement of a zoomed picture.

Pixels = TypeVar("Pixels", NDArray[np.uint8], NDArray[np.bool_])


def fitting(image: NDArray[np.uint8], interpolation: int) -> NDArray[np.uint8]:
    """Shrink an image (h, w) or (h, w, 3) to the maximum width of a picture."""
    height, width = image.shape[:2]
    if width <= PANEL_PX:
        return image
    size = (PANEL_PX, max(round(height * PANEL_PX / width), 1))
    return cv2.resize(image, size, interpolation=interpolation).astype(np.uint8)


def enlarged(image: Pixels) -> Pixels:
    """Repeat the pixels of an image (h, w, ...)."""
    return image.repeat(ZOOM, axis=0).repeat(ZOOM, axis=1)


def grey_limits(*images: NDArray) -> tuple[float, float]:
    """Return the levels [DN] drawn black and white; highlights may saturate, so that dots show."""
    low, high = np.percentile(np.concatenate([image.ravel() for image in images]), (0.5, 99.7))
    return float(low), float(max(high, low + 1))


def grey_codes(image: NDArray, limits: tuple[float, float]) -> NDArray[np.uint8]:
    """Return 8-bit grey values (h, w), by a square root, so that dark surfaces show."""
    low, high = limits
    share = np.clip((image.astype(np.float64) - low) / (high - low), 0, 1)
    return np.rint(255 * np.sqrt(share)).astype(np.uint8)
