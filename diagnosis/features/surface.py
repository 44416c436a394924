"""What a depth map is like: how smooth, in which steps, in what pieces, from where to where."""

from __future__ import annotations

import cv2
import numpy as np

from starling.diagnosis.features import bins
from starling.diagnosis.scenes.strata import Ground, Image

_LAGS_PX = (1, 2, 4, 8, 16)
_PIECES_PX = (30, 100, 300, 1000)
_STEP_PX = 1.0  # Neighbours further apart are of different pieces.


def surface(found_px: Image, ground: Ground) -> dict[str, float]:
    """Roughness and its reach, equal neighbours, small pieces and holes, range.

    Args:
        found_px: (h, w) measured disparity; NaN where there is none.
        ground: of the scene.
    """
    valid = np.isfinite(found_px)
    error = np.where(valid, found_px - ground.disparity_px, np.nan)
    where = ground.open & (np.abs(error) < 2)
    error = error - np.nanmedian(np.where(where, error, np.nan)) if where.any() else error
    found: dict[str, float] = {}
    inside = np.flatnonzero(where)
    power = bins.mean(error**2, inside)
    for lag in _LAGS_PX:
        for axis, name in ((1, "x"), (0, "y")):
            beside = np.roll(error, -lag, axis)
            both = where & np.roll(where, -lag, axis)
            found[f"surface.alike {name}{lag}"] = bins.mean(
                error * beside, np.flatnonzero(both)
            ) / max(power, 1e-9)
    for axis, name in ((1, "x"), (0, "y")):
        step = np.abs(found_px - np.roll(found_px, -1, axis))
        both = valid & np.roll(valid, -1, axis)
        found[f"surface.equal {name}"] = bins.rate(step == 0, np.flatnonzero(both))
        second = found_px - 0.5 * (np.roll(found_px, -1, axis) + np.roll(found_px, 1, axis))
        found[f"surface.rough {name}"] = bins.spread(second, inside)
    found |= _pieces(found_px, valid)
    if valid.any():
        low, high = np.quantile(found_px[valid], (0.002, 0.998))
        found["range.far"], found["range.near"] = bins.log(float(low)), bins.log(float(high))
        values = np.unique(found_px[valid])
        found["surface.values"] = bins.log(values.size / max(high - low, 1e-3))
    found["surface.columns"] = float(np.arcsin(np.sqrt(_first_column(valid) / valid.shape[1])))
    return found


def _pieces(found_px: Image, valid: np.ndarray) -> dict[str, float]:
    """Shares of pixels in small pieces of surface, and of holes in small ones."""
    filled = np.nan_to_num(found_px, nan=-1e3).astype(np.float32)
    found = {}
    joined = np.ones(valid.shape, bool)
    joined[:, 1:] &= np.abs(np.diff(filled, axis=1)) <= _STEP_PX
    joined[1:] &= np.abs(np.diff(filled, axis=0)) <= _STEP_PX
    for kind, mask in (("pieces", valid & joined), ("holes", ~valid)):
        _, _, box, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=4)
        area = box[:, cv2.CC_STAT_AREA].astype(np.float64)
        area[0] = np.inf
        for most in _PIECES_PX:
            small = area[area <= most].sum() / valid.size
            found[f"surface.{kind} below {most}"] = float(np.arcsin(np.sqrt(small)))
    return found


def _first_column(valid: np.ndarray) -> int:
    """First column of which a tenth has depth."""
    enough = valid.mean(axis=0) > 0.1
    return int(np.argmax(enough)) if enough.any() else valid.shape[1]
