"""Statistics of an image in the bins of a covariate; NaN where a bin holds too little."""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np
from numpy.typing import NDArray

from diagnosis.ground import Covariate, Ground, Image, Mask

FEWEST = 100  # Pixels that a bin must hold.
MAD_TO_SIGMA = 1.4826
_LEAST = 1e-6  # Of what a logarithm is taken.


def each(ground: Ground, *names: str) -> Iterator[tuple[str, Mask]]:
    """Bins of some covariates: `covariate.bin` and where it is (h, w)."""
    for name in names:
        covariate = ground.covariates[name]
        for number, word in enumerate(covariate.bins):
            yield f"{name}.{word}", covariate.label == number


def crossed(one: Covariate, other: Covariate) -> Iterator[tuple[str, Mask]]:
    """Bins of two covariates at once."""
    for i, first in enumerate(one.bins):
        for j, second in enumerate(other.bins):
            where = (one.label == i) & (other.label == j)
            yield f"{one.name}.{first}.{other.name}.{second}", where


def mean(values: NDArray, where: Mask) -> float:
    """Mean of finite values; NaN where they are few."""
    inside = values[where]
    inside = inside[np.isfinite(inside)]
    return float(inside.mean()) if inside.size >= FEWEST else float("nan")


def median(values: NDArray, where: Mask) -> float:
    """Median of finite values; NaN where they are few."""
    inside = values[where]
    inside = inside[np.isfinite(inside)]
    return float(np.median(inside)) if inside.size >= FEWEST else float("nan")


def spread(values: NDArray, where: Mask) -> float:
    """Logarithm of 1.4826 median absolute deviation; NaN where values are few."""
    inside = values[where]
    inside = inside[np.isfinite(inside)]
    if inside.size < FEWEST:
        return float("nan")
    deviation = np.median(np.abs(inside - np.median(inside)))
    return float(np.log(max(MAD_TO_SIGMA * deviation, _LEAST)))


def rate(event: Mask, where: Mask) -> float:
    """Arcsine of the root of a share, whose deviation does not depend on the share; NaN if few."""
    total = np.count_nonzero(where)
    if total < FEWEST:
        return float("nan")
    return float(np.arcsin(np.sqrt(np.count_nonzero(event & where) / total)))


def log(value: float) -> float:
    """Logarithm of a positive number; NaN stays."""
    return float(np.log(max(value, _LEAST))) if np.isfinite(value) else float("nan")


def smooth(image: Image, size_px: int) -> Image:
    """Mean over square windows (h, w)."""
    return np.asarray(cv2.blur(np.asarray(image, np.float32), (size_px, size_px)), np.float32)
