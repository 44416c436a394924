"""Detection of motion between repeats of a scene that should be static."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.sim.metrics import MAD_TO_SIGMA

_WINDOW_PX = 5  # Side of the smoothing window.
_OFFSET_DN = 1.0  # Difference between images that is tolerated without noise.
_OFFSET_PX = 1.0  # Difference between disparity maps tolerated: matching patches err together.
_SIGMAS = 6.0  # Noise standard deviations that are tolerated in addition.
_MOVED_SHARE = 0.01  # Share of pixels beyond these limits above which the scene has moved.
_WILD_PX = 0.5  # Disparity noise from which wrong matches alone exceed the limits.


def images_moved(repeats: NDArray[np.unsignedinteger | np.float32]) -> bool:
    """Detect motion in infrared images.

    The difference from the first repeat is taken after a common factor (flicker) is removed. It is
    smoothed and compared with the noise that differences of neighbouring pixels show.

    Args:
        repeats: (n, h, w) images [DN], n >= 1.
    """
    first, *later = (image.astype(np.float32) for image in repeats)
    for image in later:
        factor = float((first * image).sum()) / max(float((image * image).sum()), 1.0)
        difference = first - factor * image
        fine = difference - cv2.blur(difference, (3, 3))
        noise = MAD_TO_SIGMA * float(np.median(np.abs(fine - np.median(fine)))) * 3 / np.sqrt(8)
        smooth = np.abs(cv2.blur(difference, (_WINDOW_PX, _WINDOW_PX)))
        if np.mean(smooth > _OFFSET_DN + _SIGMAS * noise / _WINDOW_PX) > _MOVED_SHARE:
            return True
    return False


def depth_moved(repeats_px: NDArray[np.float32]) -> bool:
    """Detect motion in disparity maps, where two repeats are both valid.

    A repeat whose difference is dominated by wrong matches is skipped.

    Args:
        repeats_px: (n, h, w), NaN where invalid, n >= 1.
    """
    first, *later = repeats_px
    for disparity in later:
        both = np.isfinite(first) & np.isfinite(disparity)
        difference = np.where(both, first - disparity, 0).astype(np.float32)
        noise = (
            MAD_TO_SIGMA * float(np.median(np.abs(difference[both]))) if both.any() else _WILD_PX
        )
        if noise >= _WILD_PX:
            continue
        smooth = np.abs(cv2.medianBlur(difference, _WINDOW_PX))
        if np.mean(smooth[both] > _OFFSET_PX + _SIGMAS * noise) > _MOVED_SHARE:
            return True
    return False
