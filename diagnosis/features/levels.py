"""Features of an image's brightness and of its codes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from starling.diagnosis.features import bins
from starling.diagnosis.scenes.strata import Image, Mask, Strata

_PERCENTILES = (1, 5, 25, 50, 75, 95, 99, 99.9)


def level_features(image: Image, strata: Strata, ceiling: float) -> dict[str, float]:
    """Compute logarithms of mean levels (plus 1 DN) and of percentiles, and the saturated share.

    Args:
        image: (h, w) codes [DN] in the left view; the right image is warped into it.
        strata: bins of the scene.
        ceiling: largest code.
    """
    features = {}
    for name in ("radius", "depth", "x", "y", "level"):
        for bin_name, where in strata.crossed_bins(name, "dots"):
            features[f"level.{bin_name}"] = bins.log(1 + bins.mean(image, where))
    inside = image[strata.counted & np.isfinite(image)]
    if inside.size < bins.FEWEST:
        return features
    share = _shares(_histogram(inside, ceiling))
    # Levels are taken as uniform within a code, so that percentiles resolve small shifts.
    values = np.interp(np.divide(_PERCENTILES, 100), share, np.arange(share.size) - 0.5)
    for percent, value in zip(_PERCENTILES, values, strict=True):
        features[f"level.percentile {percent:g}"] = bins.log(1 + max(float(value), 0.0))
    features["level.full"] = float(np.arcsin(np.sqrt(np.mean(inside >= ceiling))))
    return features


def code_features(image: Image, where: Mask, ceiling: float) -> dict[str, float]:
    """Compute the share of empty codes, and how much a code's frequency differs from neighbours'.

    Args:
        image: (h, w) output image of one imager [DN], not resampled: that would mix codes.
        where: (h, w) pixels that count.
        ceiling: largest code.
    """
    features: dict[str, float] = {}
    inside = image[where]
    if inside.size < bins.FEWEST:
        return features
    count = _histogram(inside, ceiling)
    share = _shares(count)
    low, high = np.searchsorted(share[1:], (0.05, 0.95))
    used = count[low : high + 1]
    features["codes.empty"] = float(np.mean(used == 0)) if used.size else float("nan")
    # Without converter steps a code is as frequent as its neighbours.
    if used.size > 4:
        expected = 0.5 * (used[:-2] + used[2:])
        features["codes.comb"] = float(np.abs(used[1:-1] - expected).sum() / max(used.sum(), 1))
    return features


def _histogram(inside: NDArray, ceiling: float) -> NDArray[np.int64]:
    """Count pixels by code."""
    return np.bincount(np.clip(np.rint(inside), 0, ceiling).astype(np.int64))


def _shares(count: NDArray[np.int64]) -> NDArray[np.float64]:
    """Compute the share of pixels below each code, and below the code after the last."""
    return np.concatenate([[0.0], np.cumsum(count) / count.sum()])
