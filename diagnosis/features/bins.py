"""Statistics of an image in the bins of a covariate; NaN where a bin holds too little."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.diagnosis.scenes.strata import Image, Mask, Pixels
from starling.sim.metrics import MAD_TO_SIGMA

FEWEST = 100  # Pixels that a bin must hold.
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
    inside = _known(values, where)
    return float("nan") if inside is None else _middle(inside)


def spread(values: NDArray, where: Pixels) -> float:
    """Logarithm of 1.4826 median absolute deviation; NaN where values are few."""
    return median_and_spread(values, where)[1]


def median_and_spread(values: NDArray, where: Pixels) -> tuple[float, float]:
    """As `median` and `spread`, whose median is then taken once."""
    inside = _known(values, where)
    if inside is None:
        return float("nan"), float("nan")
    middle = _middle(inside)
    deviation = _middle(np.abs(inside - inside.dtype.type(middle)))
    return middle, float(np.log(max(MAD_TO_SIGMA * deviation, _LEAST)))


def _known(values: NDArray, where: Pixels) -> NDArray | None:
    inside = values.ravel()[where]
    inside = inside[np.isfinite(inside)]
    return inside if inside.size >= FEWEST else None


def _middle(inside: NDArray) -> float:
    """Median of finite values; half the time of NumPy's, which looks for NaN."""
    half = inside.size // 2
    parted = np.partition(inside, half)
    above = parted[half]
    return float(above if inside.size % 2 else (parted[:half].max() + above) / 2)


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
