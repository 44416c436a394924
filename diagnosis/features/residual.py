"""What an image has that the simulator does not expect: noise by level, rows, columns, outliers."""

from __future__ import annotations

import numpy as np

from starling.diagnosis.features import bins
from starling.diagnosis.scenes.strata import Ground, Image

_WINDOW_PX = 15
_OUTLIER = 6.0  # Robust deviations.


def residual(image: Image, ground: Ground) -> dict[str, float]:
    """Fit the expected image in small windows (gain and offset) and look at what is left."""
    fine = np.asarray(image, np.float32)
    expected = ground.expected
    mean, mean_expected = bins.smooth(fine, _WINDOW_PX), bins.smooth(expected, _WINDOW_PX)
    covariance = bins.smooth(fine * expected, _WINDOW_PX) - mean * mean_expected
    variance = bins.smooth(expected**2, _WINDOW_PX) - mean_expected**2
    gain = covariance / np.maximum(variance, 1e-6 * float(expected.var()) + 1e-12)
    fitted = mean + gain * (expected - mean_expected)
    left = fine - fitted
    found = {}
    for name, where in ground.each("expected"):
        found[f"noise.{name}"] = bins.spread(left, where)
        inside = left.ravel()[where]
        if inside.size >= bins.FEWEST:
            sigma = max(np.exp(found[f"noise.{name}"]), 1e-3)
            found[f"noise.tails.{name}"] = float(np.log(max(inside.std(), 1e-3) / sigma))
    for name, where in ground.each("radius", "depth"):
        found[f"noise.{name}"] = bins.spread(left, where)
    mask = ground.covariates["dots"].where("between")
    between = np.flatnonzero(mask)
    masked = np.where(mask, left, np.nan)
    sigma = max(np.exp(bins.spread(left, between)), 1e-3)
    with np.errstate(invalid="ignore"):
        outlier = np.abs(left) > _OUTLIER * sigma
    found["noise.outliers"] = bins.rate(outlier, between)
    found["noise.bright outliers"] = bins.rate(outlier & (left > 0), between)
    for axis, name in ((1, "rows"), (0, "columns")):
        count = np.isfinite(masked).sum(axis=axis)
        enough = count >= bins.FEWEST // 4
        if enough.sum() > 20:
            lines = np.nansum(masked, axis=axis)[enough] / count[enough]
            lines = lines - np.convolve(lines, np.ones(9) / 9, mode="same")
            by_chance = sigma / np.sqrt(np.median(count[enough]))
            found[f"noise.{name}"] = bins.log(float(np.std(lines[5:-5])) / by_chance)
    power = bins.mean(left**2, between)
    for dx, dy in ((1, 0), (0, 1), (2, 0), (0, 2), (1, 1)):
        beside = left * np.roll(left, (-dy, -dx), axis=(0, 1))
        found[f"noise.alike {dx},{dy}"] = bins.mean(beside, between) / max(power, 1e-9)
    return found
