"""Features of depth: errors, holes, surface, difference from our matcher, and change in time.

Areas below a size are not monotone: a growing piece or hole leaves its class. Shares of wrong
matches and pixelwise differences are capped.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.diagnosis.features import bins
from starling.diagnosis.scenes.observation import DepthObservation, FullObservation
from starling.diagnosis.scenes.strata import FAR_OFF_PX, Image, Pixels, Strata

_PLACES = ("depth", "x", "y", "radius", "level", "incidence")
_RELATIVE_PLACES = ("edge", "level", "depth")
_MOST_PX = 1.0  # Upper limit of a difference: beyond it is a wrong match of unknown size.
_SMOOTHEST_PX = 1e-3  # Added to a roughness: keeps its logarithm finite on planes.
_LAGS_PX = (1, 2, 4, 8, 16)  # Lags of the error's autocorrelation.
_AREAS_PX = (30, 100, 300, 1000)  # Areas below which segments and holes are small.
_STEP_PX = 1.0  # Larger differences of neighbours separate segments.

Features = dict[str, float]


def depth_features(depth: DepthObservation, strata: Strata) -> Features:
    """Compute features of device depth.

    Args:
        depth: device depth.
        strata: reference and bins of the scene.
    """
    features = disparity_features(depth.device_px[0], strata)
    features |= surface_features(depth.device_px[0], strata)
    if len(depth.device_px) > 1:
        features |= depth_repeat_features(depth.device_px, strata)
    return features


def matched_depth_features(full: FullObservation, strata: Strata, captured_px: Image) -> Features:
    """Compute features of device depth, also relative to our matcher's depth of the same images.

    Args:
        full: infrared images and device depth.
        strata: reference and bins of the scene.
        captured_px: (h, w) captured device disparity of these images.
    """
    device = full.device_px[0]
    features = depth_features(full, strata)
    features |= bias_features(device, full.ours_px[0], strata)
    return features | difference_features(device, captured_px, strata)


def disparity_features(measured_px: Image, strata: Strata) -> dict[str, float]:
    """Compute bias, spread and rates of wrong matches and holes, by bin.

    Args:
        measured_px: (h, w) measured disparity; NaN where invalid.
        strata: reference and bins of the scene.
    """
    error = measured_px - strata.disparity_px
    [(_, everywhere)], [(_, interior)] = strata.all_pixels(), strata.all_pixels(interior=True)
    valid = np.isfinite(measured_px)
    missing = ~valid
    wrong = np.nan_to_num(np.abs(error), nan=0.0) > FAR_OFF_PX
    middle, spread = _bias_and_spread(error, interior)
    features = {
        "error.bias.all": middle,
        "error.spread.all": spread,
        "error.far off.all": bins.rate(wrong, bins.among(everywhere, valid)),
        "holes.all": bins.rate(missing, everywhere),
    }
    for name, where in strata.bins(*_PLACES, interior=True):
        bias, spread = _bias_and_spread(error, where)
        features |= {f"error.bias.{name}": bias, f"error.spread.{name}": spread}
    for name, where in strata.bins(*_PLACES):
        features[f"holes.{name}"] = bins.rate(missing, where)
    # Foreground that grows over an edge crowds there too, so the crowd of the surfaces counts.
    near = _near(error, middle)
    for name, where in strata.bins("edge"):
        bias, spread = bins.median_and_spread(near, where)
        features |= {f"error.bias.{name}": bias, f"error.spread.{name}": spread}
        features[f"error.far off.{name}"] = bins.rate(wrong, bins.among(where, valid))
        features[f"holes.{name}"] = bins.rate(missing, where)
    for name, where in strata.bins("fraction", interior=True):
        features[f"error.fraction.{name}"] = _bias_and_spread(error, where)[0] - middle
    return features


def _bias_and_spread(error_px: NDArray, where: Pixels) -> tuple[float, float]:
    """Compute the median error and the logarithm of its spread, without wrong matches."""
    return bins.crowd_median_and_spread(error_px, where, FAR_OFF_PX)


def _near(error_px: NDArray, middle_px: float) -> NDArray:
    """Remove errors far from the bias of the surfaces; of none if that is unknown."""
    middle_px = float(np.nan_to_num(middle_px))
    return np.where(np.abs(error_px - middle_px) <= FAR_OFF_PX, error_px, np.nan)


def bias_features(measured_px: Image, ours_px: Image, strata: Strata) -> dict[str, float]:
    """Compute the median difference from our matcher's disparity, by bin.

    The spread is not a feature. It is zero where our matcher is simulated, so that any effect on
    depth would increase it towards the device's.

    Args:
        measured_px: (h, w) disparity; NaN where invalid.
        ours_px: (h, w) disparity by our matcher without effects.
        strata: bins of the scene.
    """
    difference = measured_px - ours_px
    [(_, interior)] = strata.all_pixels(interior=True)
    near = _near(difference, _bias_and_spread(difference, interior)[0])
    return {
        f"against.bias.{name}": bins.median_and_spread(near, where)[0]
        for name, where in (*strata.all_pixels(), *strata.bins(*_RELATIVE_PLACES))
    }


def difference_features(measured_px: Image, captured_px: Image, strata: Strata) -> dict[str, float]:
    """Compute pixelwise differences from the captured device disparity, by bin.

    Args:
        measured_px: (h, w) disparity; NaN where invalid.
        captured_px: (h, w) captured device disparity of the same pair.
        strata: bins of the scene.
    """
    measured, captured = np.isfinite(measured_px), np.isfinite(captured_px)
    both = measured & captured
    difference = np.minimum(np.abs(measured_px - captured_px), _MOST_PX)
    features = {}
    for name, where in (*strata.all_pixels(), *strata.bins(*_RELATIVE_PLACES)):
        features[f"unlike.holes.{name}"] = bins.rate(measured != captured, where)
        features[f"unlike.disparity.{name}"] = bins.mean(difference, bins.among(where, both))
    return features


def surface_features(measured_px: Image, strata: Strata) -> dict[str, float]:
    """Compute roughness, its autocorrelation, equal neighbours, small segments, holes and range.

    Args:
        measured_px: (h, w) measured disparity; NaN where invalid.
        strata: reference and bins of the scene.
    """
    valid = np.isfinite(measured_px)
    error = np.where(valid, measured_px - strata.disparity_px, np.nan)
    bias_px, _ = _bias_and_spread(error, np.flatnonzero(strata.interior))
    error = error - np.nan_to_num(bias_px)
    where = strata.interior & (np.abs(error) < FAR_OFF_PX)
    features: dict[str, float] = {}
    inside = np.flatnonzero(where)
    power = bins.mean(error**2, inside)
    for lag in _LAGS_PX:
        for axis, name in ((1, "x"), (0, "y")):
            lagged = np.roll(error, -lag, axis)
            both = where & np.roll(where, -lag, axis)
            features[f"surface.alike {name}{lag}"] = bins.mean(
                error * lagged, np.flatnonzero(both)
            ) / max(power, 1e-9)
    for axis, name in ((1, "x"), (0, "y")):
        step = np.abs(measured_px - np.roll(measured_px, -1, axis))
        both = valid & np.roll(valid, -1, axis)
        features[f"surface.equal {name}"] = bins.rate(step == 0, np.flatnonzero(both))
        second = measured_px - 0.5 * (
            np.roll(measured_px, -1, axis) + np.roll(measured_px, 1, axis)
        )
        # A mean, as most second differences of quantised disparity are 0 and so is their median.
        rough_px = bins.mean(np.minimum(np.abs(second), _MOST_PX), inside)
        features[f"surface.rough {name}"] = bins.log(rough_px + _SMOOTHEST_PX)
    features |= _small_areas(measured_px, valid)
    if valid.any():
        low, high = np.quantile(measured_px[valid], (0.002, 0.998))
        features["range.far"], features["range.near"] = bins.log(float(low)), bins.log(float(high))
        values = np.unique(measured_px[valid])
        features["surface.values"] = bins.log(values.size / max(high - low, 1e-3))
    features["surface.columns"] = float(np.arcsin(np.sqrt(_first_column(valid) / valid.shape[1])))
    return features


def _small_areas(measured_px: Image, valid: np.ndarray) -> dict[str, float]:
    """Compute shares of pixels in small segments of surface, and in small holes."""
    filled = np.nan_to_num(measured_px, nan=-1e3).astype(np.float32)
    features = {}
    connected = np.ones(valid.shape, bool)
    connected[:, 1:] &= np.abs(np.diff(filled, axis=1)) <= _STEP_PX
    connected[1:] &= np.abs(np.diff(filled, axis=0)) <= _STEP_PX
    for kind, mask in (("pieces", valid & connected), ("holes", ~valid)):
        _, _, box, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=4)
        area = box[:, cv2.CC_STAT_AREA].astype(np.float64)
        area[0] = np.inf
        for most in _AREAS_PX:
            small = area[area <= most].sum() / valid.size
            features[f"surface.{kind} below {most}"] = float(np.arcsin(np.sqrt(small)))
    return features


def _first_column(valid: np.ndarray) -> int:
    """Return the first column with a tenth of its pixels valid."""
    enough = valid.mean(axis=0) > 0.1
    return int(np.argmax(enough)) if enough.any() else valid.shape[1]


def depth_repeat_features(frames_px: NDArray, strata: Strata) -> dict[str, float]:
    """Compute temporal noise of disparity, and the rate of holes that appear or vanish.

    Args:
        frames_px: (n, h, w) disparity, NaN where invalid, n >= 2.
        strata: bins of the scene.
    """
    valid = np.isfinite(frames_px)
    steady = valid.all(axis=0)
    step = np.diff(frames_px, axis=0)
    change = np.where(steady, np.abs(step).mean(axis=0), np.nan)
    [(_, everywhere)] = strata.all_pixels()
    features = {
        "time.disparity": bins.log(bins.mean(change, everywhere)),
        "time.holes": bins.rate((valid[1:] != valid[:-1]).any(axis=0), everywhere),
    }
    if len(frames_px) >= 3:
        product = np.where(steady, (step[1:] * step[:-1]).mean(axis=0), np.nan)
        power = np.where(steady, (step**2).mean(axis=0), np.nan)
        # -1/2 for independent frames; closer to 0 with a temporal filter.
        ratio = bins.mean(product, everywhere) / max(bins.mean(power, everywhere), 1e-9)
        features["time.carried on"] = float(ratio)
    return features
