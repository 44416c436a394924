"""Whether repeats of a scene, which is to keep still, differ by more than noise and light do."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.sim.metrics import MAD_TO_SIGMA

# Repeats are still if of their differences, smoothed by so much, no more than a share of the pixels
# is beyond so many codes and so many deviations of noise,
_CALM_PX, _CALM_DN, _CALM, _CALM_SHARE = 5, 1.0, 6.0, 0.01
_CALM_DISPARITY_PX = 1.0  # or so many pixels of disparity: patches of a matcher err together.
_WILD_PX = 0.5  # Noise from which on wrong matches alone are as many.


def images(repeats: NDArray[np.unsignedinteger | np.float32]) -> bool:
    """Look at infrared.

    What is left of the differences after a common factor is compared with what noise of the size
    that neighbours differ by would leave.

    Args:
        repeats: (n, h, w) codes, n >= 1.
    """
    first, *others = (one.astype(np.float32) for one in repeats)
    for one in others:
        factor = float((first * one).sum()) / max(float((one * one).sum()), 1.0)
        apart = first - factor * one
        fine = apart - cv2.blur(apart, (3, 3))
        noise = MAD_TO_SIGMA * float(np.median(np.abs(fine - np.median(fine)))) * 3 / np.sqrt(8)
        smooth = np.abs(cv2.blur(apart, (_CALM_PX, _CALM_PX)))
        if np.mean(smooth > _CALM_DN + _CALM * noise / _CALM_PX) > _CALM_SHARE:
            return True
    return False


def depth(repeats_px: NDArray[np.float32]) -> bool:
    """Look at disparity, where both of two repeats have it; what is all noise tells nothing.

    Args:
        repeats_px: (n, h, w), NaN where there is none, n >= 1.
    """
    first, *others = repeats_px
    for one in others:
        both = np.isfinite(first) & np.isfinite(one)
        apart = np.where(both, first - one, 0).astype(np.float32)
        noise = MAD_TO_SIGMA * float(np.median(np.abs(apart[both]))) if both.any() else _WILD_PX
        if noise >= _WILD_PX:
            continue
        calm = np.abs(cv2.medianBlur(apart, _CALM_PX))
        if np.mean(calm[both] > _CALM_DISPARITY_PX + _CALM * noise) > _CALM_SHARE:
            return True
    return False
