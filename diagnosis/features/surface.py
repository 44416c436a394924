"""Features of the structure of a depth map: roughness, steps, small segments, range."""

from __future__ import annotations

import cv2
import numpy as np

from starling.diagnosis.features import bins
from starling.diagnosis.scenes.strata import Image, Strata

_LAGS_PX = (1, 2, 4, 8, 16)  # Lags of the error's autocorrelation.
_AREAS_PX = (30, 100, 300, 1000)  # Areas below which segments and holes are small.
_STEP_PX = 1.0  # Larger differences of neighbours separate segments.


def surface_features(measured_px: Image, strata: Strata) -> dict[str, float]:
    """Compute roughness, its autocorrelation, equal neighbours, small segments, holes and range.

    Args:
        measured_px: (h, w) measured disparity; NaN where invalid.
        strata: reference and bins of the scene.
    """
    valid = np.isfinite(measured_px)
    error = np.where(valid, measured_px - strata.disparity_px, np.nan)
    where = strata.interior & (np.abs(error) < 2)
    error = error - np.nanmedian(np.where(where, error, np.nan)) if where.any() else error
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
        features[f"surface.rough {name}"] = bins.spread(second, inside)
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
