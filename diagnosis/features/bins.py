"""Statistics of images in bins of pixels; NaN if a bin holds too few valid pixels."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.diagnosis.scenes.strata import Image, Mask, Pixels
from starling.sim.metrics import MAD_TO_SIGMA

FEWEST = 100  # Least number of pixels in a bin.
FARTHEST = 6  # Largest value at which a crowd is looked for: 3 % of 200 px of disparity.
_SAMPLE = 20_000  # Number of values among which a crowd is looked for.
_CROWD = 0.15  # Least share of the values in a crowd; wrong matches give 0.04 by chance.
# Least spread, in DN or px. Quantised values may have a median deviation of 0, and its logarithm
# would jump.
_NARROWEST = 1e-3
_LEAST = 1e-6  # Lower limit of the argument of a logarithm.


def mean(values: NDArray, where: Pixels) -> float:
    """Average finite values; NaN if they are too few."""
    if where.size < FEWEST:
        return float("nan")
    inside = values.ravel()[where]
    average = float(inside.mean())
    if np.isfinite(average):  # Then all values are finite: most images have no gaps.
        return average
    inside = inside[np.isfinite(inside)]
    return float(inside.mean()) if inside.size >= FEWEST else float("nan")


def spread(values: NDArray, where: Pixels) -> float:
    """Compute the logarithm of 1.4826 median absolute deviation; NaN if values are too few."""
    return median_and_spread(values, where)[1]


def median_and_spread(values: NDArray, where: Pixels) -> tuple[float, float]:
    """Compute the median of finite values, and `spread`; NaN if they are too few."""
    inside = _finite(values, where)
    if inside is None:
        return float("nan"), float("nan")
    middle = _median(inside)
    deviation = _median(np.abs(inside - inside.dtype.type(middle)))
    return middle, float(np.log(max(MAD_TO_SIGMA * deviation, _NARROWEST)))


def crowd_median_and_spread(values: NDArray, where: Pixels, reach: float) -> tuple[float, float]:
    """Compute `median_and_spread` of the values within `reach` of the most frequent value.

    Values far off, such as wrong matches, do not count, wherever the most frequent value lies.
    Both are NaN if it lies beyond `FARTHEST`, or if few values are near it.
    """
    inside = _finite(values, where)
    if inside is None:
        return float("nan"), float("nan")
    sample = inside[:: max(1, inside.size // _SAMPLE)]
    cells = np.clip(np.rint(sample), -FARTHEST - 1, FARTHEST + 1).astype(np.intp) + FARTHEST + 1
    count = np.bincount(cells, minlength=2 * FARTHEST + 3)[1:-1]
    crowded = np.convolve(count, np.bartlett(2 * int(reach) + 3), mode="same")
    middle = float(np.argmax(crowded) - FARTHEST)
    near = sample[np.abs(sample - middle) <= reach + 0.5]  # Half a cell more.
    if near.size < max(FEWEST, _CROWD * sample.size):
        return float("nan"), float("nan")
    near = inside[np.abs(inside - _median(near)) <= reach]
    return median_and_spread(near, np.arange(near.size))


def _finite(values: NDArray, where: Pixels) -> NDArray | None:
    inside = values.ravel()[where]
    inside = inside[np.isfinite(inside)]
    return inside if inside.size >= FEWEST else None


def _median(inside: NDArray) -> float:
    """Compute the median of finite values in half of NumPy's time, which checks for NaN."""
    half = inside.size // 2
    partitioned = np.partition(inside, half)
    above = partitioned[half]
    return float(above if inside.size % 2 else (partitioned[:half].max() + above) / 2)


def rate(event: Mask, where: Pixels) -> float:
    """Compute the arcsine of the root of a share, which stabilises its variance; NaN if too few."""
    if where.size < FEWEST:
        return float("nan")
    return float(np.arcsin(np.sqrt(np.count_nonzero(event.ravel()[where]) / where.size)))


def log(value: float) -> float:
    """Compute the logarithm of a positive number; NaN stays NaN."""
    return float(np.log(max(value, _LEAST))) if np.isfinite(value) else float("nan")


def smooth(image: Image, size_px: int) -> Image:
    """Average over square windows (h, w)."""
    return np.asarray(cv2.blur(np.asarray(image, np.float32), (size_px, size_px)), np.float32)


def among(where: Pixels, mask: Mask) -> Pixels:
    """Select the pixels that lie in a mask (h, w)."""
    return where[mask.ravel()[where]]
