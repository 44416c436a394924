"""Features of infrared pairs: levels, codes, texture, outliers, and change in time.

Texture and noise are not monotone where an image becomes full or empty. `texture.slope` rises again
above 1 px of blur, where noise outweighs the dots. `noise.tails` falls above 0.25 % of hot pixels.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.diagnosis.features import bins
from starling.diagnosis.features.depth import Features, disparity_features
from starling.diagnosis.features.shifts import (
    dot_shift_features,
    pair_shift_features,
    warp_to_left,
)
from starling.diagnosis.scenes.observation import StereoObservation
from starling.diagnosis.scenes.strata import Image, Mask, Strata

_PERCENTILES = (1, 5, 25, 50, 75, 95, 99, 99.9)
_SHIFTS = ((1, 0), (2, 0), (3, 0), (0, 1), (0, 2), (0, 3), (1, 1), (1, -1))  # (x, y) [px].
_FIT_PX = 15  # Side of the windows of the local fit.
_OUTLIER = 6.0  # Robust standard deviations from which a pixel is an outlier.


def image_features(pairs: StereoObservation, strata: Strata, *, ceiling: float) -> Features:
    """Compute features of infrared images and of our matcher's disparity from them.

    Only features in time use all repeats; all others use the first one.

    Args:
        pairs: infrared images.
        strata: reference and bins of the scene.
        ceiling: largest code.
    """
    left, right = (images[0].astype(np.float32) for images in (pairs.left, pairs.right))
    warped = warp_to_left(right, strata.disparity_px)
    features = level_features(np.rint(left), strata, ceiling)
    features |= code_features(left, strata.counted, ceiling)
    features |= _prefixed("right", level_features(warped, strata, ceiling))
    features |= _prefixed("right", code_features(right, np.ones(right.shape, bool), ceiling))
    features |= texture_features(left, strata)
    features |= _prefixed("right", texture_features(warped, strata, ("radius",)))
    features |= residual_features(left, strata)
    features |= pair_shift_features(left, right, strata)
    features |= dot_shift_features(left, strata)
    features |= disparity_features(pairs.ours_px[0], strata)
    if len(pairs.left) > 1:
        features |= infrared_repeat_features(pairs.left, strata)
    return features


def _prefixed(prefix: str, features: Features) -> Features:
    return {f"{prefix} {name}": value for name, value in features.items()}


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


def texture_features(
    image: Image, strata: Strata, places: tuple[str, ...] = ("radius", "depth", "y")
) -> dict[str, float]:
    """Compute energies at the finest scales, by bin, and the autocorrelation of near pixels."""
    fine = np.asarray(image, np.float32)
    laplacian = cv2.Laplacian(fine, cv2.CV_32F) ** 2
    across = cv2.Sobel(fine, cv2.CV_32F, 1, 0) ** 2
    down = cv2.Sobel(fine, cv2.CV_32F, 0, 1) ** 2
    band = (cv2.GaussianBlur(fine, (0, 0), 1.0) - cv2.GaussianBlur(fine, (0, 0), 2.0)) ** 2
    features = {}
    for name in places:
        for bin_name, where in strata.crossed_bins(name, "dots"):
            sharp = bins.log(bins.mean(laplacian, where))
            features[f"texture.laplacian.{bin_name}"] = sharp
            coarse = bins.log(bins.mean(band, where))
            features[f"texture.slope.{bin_name}"] = sharp - coarse
            features[f"texture.direction.{bin_name}"] = bins.log(
                bins.mean(across, where)
            ) - bins.log(bins.mean(down, where))
    high = fine - bins.smooth(fine, 9)
    for bin_name, where in strata.bins("dots"):
        power = bins.mean(high**2, where)
        for dx, dy in _SHIFTS:
            product = high * np.roll(high, (-dy, -dx), axis=(0, 1))
            name = f"texture.alike {dx},{dy}.{bin_name}"
            features[name] = bins.mean(product, where) / max(power, 1e-9)
    return features


def residual_features(image: Image, strata: Strata) -> dict[str, float]:
    """Fit the expected image by a local gain and offset, and compute features of the residual."""
    fine = np.asarray(image, np.float32)
    expected = strata.expected
    mean, mean_expected = bins.smooth(fine, _FIT_PX), bins.smooth(expected, _FIT_PX)
    covariance = bins.smooth(fine * expected, _FIT_PX) - mean * mean_expected
    variance = bins.smooth(expected**2, _FIT_PX) - mean_expected**2
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


def infrared_repeat_features(frames: NDArray, strata: Strata) -> dict[str, float]:
    """Compute temporal noise by level, of whole images (flicker), of rows and of columns.

    Args:
        frames: (n, h, w) images [DN], n >= 2.
        strata: bins of the scene.
    """
    stack = frames.astype(np.float32)
    deviation = stack.std(axis=0, ddof=1)
    features = {
        f"time.noise.{name}": bins.log(bins.mean(deviation, where))
        for name, where in strata.bins("expected")
    }
    means = stack.reshape(len(stack), -1).mean(axis=1)
    features["time.flicker"] = bins.log(float(means.std(ddof=1) / max(means.mean(), 1e-3)))
    change = stack - stack.mean(axis=0)
    features["time.rows"] = bins.log(float(change.mean(axis=2).std()))
    features["time.columns"] = bins.log(float(change.mean(axis=1).std()))
    return features
