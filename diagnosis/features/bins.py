"""Statistics of an image in the bins of a covariate; NaN where a bin holds too little."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from diagnosis.ground import Image, Mask, Pixels

FEWEST = 100  # Pixels that a bin must hold.
MAD_TO_SIGMA = 1.4826
_LEAST = 1e-6  # Of what a logarithm is taken.


def mean(values: NDArray, where: Pixels) -> float:
    """Mean of finite values; NaN where they are few."""
    if where.size < FEWEST:
        return float("nan")
    inside = values.ravel()[where]
    found = float(inside.mean())
    if np.isfinite(found):  # So are all: most images have no gaps.
        return found
    inside = inside[np.isfinite(inside)]
    return float(inside.mean()) if inside.size >= FEWEST else float("nan")


def median(values: NDArray, where: Pixels) -> float:
    """Median of finite values; NaN where they are few."""
    inside = values.ravel()[where]
    inside = inside[np.isfinite(inside)]
    return float(np.median(inside)) if inside.size >= FEWEST else float("nan")


def spread(values: NDArray, where: Pixels) -> float:
    """Logarithm of 1.4826 median absolute deviation; NaN where values are few."""
    inside = values.ravel()[where]
    inside = inside[np.isfinite(inside)]
    if inside.size < FEWEST:
        return float("nan")
    deviation = np.median(np.abs(inside - np.median(inside)))
    return float(np.log(max(MAD_TO_SIGMA * deviation, _LEAST)))


def rate(event: Mask, where: Pixels) -> float:
    """Arcsine of the root of a share, whose deviation does not depend on the share; NaN if few."""
    if where.size < FEWEST:
        return float("nan")
    return float(np.arcsin(np.sqrt(np.count_nonzero(event.ravel()[where]) / where.size)))


def log(value: float) -> float:
    """Logarithm of a positive number; NaN stays."""
    return float(np.log(max(value, _LEAST))) if np.isfinite(value) else float("nan")


def smooth(image: Image, size_px: int) -> Image:
    """Mean over square windows (h, w)."""
    return np.asarray(cv2.blur(np.asarray(image, np.float32), (size_px, size_px)), np.float32)


def among(where: Pixels, mask: Mask) -> Pixels:
    """Those of some pixels that lie in a mask (h, w)."""
    return where[mask.ravel()[where]]
