"""Reference depth of captures without one, estimated from the depth of the device."""

from __future__ import annotations

import cv2
import numpy as np

from starling.learning.data.example import Image
from starling.sim.arrays import filled
from starling.sim.captures.info import CaptureInfo

WIDEST = 0.1  # Holes wider than this share of the columns keep no reference.
_JUMP_PX = 1.0  # A larger disparity difference of both rims separates surfaces [px].
_LEVEL_PX = 0.5  # Sigma of the smoothing in disparity [px]: above noise, below steps.
_PLACE_PX = 5.0  # Sigma of the smoothing in the image [px].
_PASSES = 2


def estimate(depth_m: Image, info: CaptureInfo) -> Image:
    """Estimate the depth (h, w) [m] of the surfaces, NaN where unknown.

    A hole continues the farther rim of its row, because stereo shadows hide the background. All
    surfaces are then smoothed equally. Noise would otherwise show where the device has depth.

    Args:
        depth_m: depth of the device, NaN where missing.
        info: camera.
    """
    disparity = _without_holes(info.disparity_px(depth_m))
    known = np.isfinite(disparity)
    smooth = filled(disparity, known) if known.any() else disparity
    for _ in range(_PASSES):
        smooth = cv2.bilateralFilter(smooth, -1, _LEVEL_PX, _PLACE_PX)
    return info.disparity_px(np.where(known, smooth, np.float32(np.nan)))


def _without_holes(disparity_px: Image) -> Image:
    """Fill holes between two rims of a row; NaN remains beyond the rims and in wide holes."""
    known, width = np.isfinite(disparity_px), disparity_px.shape[1]
    column = np.arange(width)
    before = np.maximum.accumulate(np.where(known, column, -1), axis=1)
    after = np.minimum.accumulate(np.where(known, column, width)[:, ::-1], axis=1)[:, ::-1]
    left = np.take_along_axis(disparity_px, np.maximum(before, 0), axis=1)
    right = np.take_along_axis(disparity_px, np.minimum(after, width - 1), axis=1)
    share = ((column - before) / np.maximum(after - before, 1)).astype(np.float32)
    within = left + share * (right - left)
    value = np.where(np.abs(left - right) <= _JUMP_PX, within, np.minimum(left, right))
    enclosed = (before >= 0) & (after < width) & (after - before <= WIDEST * width)
    return np.where(known, disparity_px, np.where(enclosed, value, np.float32(np.nan)))
