"""Features of the residual from the expected image: noise, row and column noise, outliers."""

from __future__ import annotations

import numpy as np

from starling.diagnosis.features import bins
from starling.diagnosis.scenes.strata import Image, Strata

_WINDOW_PX = 15  # Side of the windows of the local fit.
_OUTLIER = 6.0  # Robust standard deviations from which a pixel is an outlier.


def residual_features(image: Image, strata: Strata) -> dict[str, float]:
    """Fit the expected image by a local gain and offset, and compute features of the residual."""
    fine = np.asarray(image, np.float32)
    expected = strata.expected
    mean, mean_expected = bins.smooth(fine, _WINDOW_PX), bins.smooth(expected, _WINDOW_PX)
    covariance = bins.smooth(fine * expected, _WINDOW_PX) - mean * mean_expected
    variance = bins.smooth(expected**2, _WINDOW_PX) - mean_expected**2
    gain = covariance / np.maximum(variance, 1e-6 * float(expected.var()) + 1e-12)
    fitted = mean + gain * (expected - mean_expected)
    residual = fine - fitted
    features = {}
    for name, where in strata.bins("expected"):
        features[f"noise.{name}"] = bins.spread(residual, where)
        inside = residual.ravel()[where]
        if inside.size >= bins.FEWEST:
            sigma = max(np.exp(features[f"noise.{name}"]), 1e-3)
            features[f"noise.tails.{name}"] = float(np.log(max(inside.std(), 1e-3) / sigma))
    for name, where in strata.bins("radius", "depth"):
        features[f"noise.{name}"] = bins.spread(residual, where)
    mask = strata.covariates["dots"].mask("between")
    between = np.flatnonzero(mask)
    masked = np.where(mask, residual, np.nan)
    sigma = max(np.exp(bins.spread(residual, between)), 1e-3)
    with np.errstate(invalid="ignore"):
        outlier = np.abs(residual) > _OUTLIER * sigma
    features["noise.outliers"] = bins.rate(outlier, between)
    features["noise.bright outliers"] = bins.rate(outlier & (residual > 0), between)
    for axis, name in ((1, "rows"), (0, "columns")):
        count = np.isfinite(masked).sum(axis=axis)
        enough = count >= bins.FEWEST // 4
        if enough.sum() > 20:
            lines = np.nansum(masked, axis=axis)[enough] / count[enough]
            lines = lines - np.convolve(lines, np.ones(9) / 9, mode="same")
            by_chance = sigma / np.sqrt(np.median(count[enough]))
            features[f"noise.{name}"] = bins.log(float(np.std(lines[5:-5])) / by_chance)
    power = bins.mean(residual**2, between)
    for dx, dy in ((1, 0), (0, 1), (2, 0), (0, 2), (1, 1)):
        product = residual * np.roll(residual, (-dy, -dx), axis=(0, 1))
        features[f"noise.alike {dx},{dy}"] = bins.mean(product, between) / max(power, 1e-9)
    return features
