"""What the methods that learn nothing share: what they trust and keep, and the image they go by."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.learning.completion.frame import Frame, Image, Mask
from starling.learning.completion.method import Completed, untold

_LEVEL = 0.45  # Mean that the image is exposed to: what a colour camera's exposure aims at.
_ISLAND_PX = 400  # Patches of depth up to this large are not spread.
_STEP = 0.05  # Ratio of neighbouring depths, less 1, that parts two patches.
_LOG_STEPS = 1000  # Of a patch's depth, per unit of its logarithm.


def completed(frame: Frame, filled_m: NDArray[np.floating]) -> Completed:
    """Depth as the camera gave it where it did, bit for bit, and as filled elsewhere.

    None of these methods knows its error: sigma is NaN.
    """
    depth = np.where(frame.valid, frame.depth_m, filled_m).astype(np.float32)
    return Completed(depth_m=depth, sigma_m=untold(frame))


def trusted(frame: Frame) -> Mask:
    """Valid pixels that holes are filled from, (h, w).

    Small patches of a depth of their own, alone in a hole, are mostly false matches, and spread
    over all of it. Where most of the depth is such, as of a few scattered points, all is trusted.
    """
    log = np.log(np.where(frame.valid, frame.depth_m, np.float32(1)))
    code = np.where(frame.valid, _LOG_STEPS * (log - log.min()) + 1, 0)
    patches = np.minimum(code, np.iinfo(np.int16).max).astype(np.int16)
    cv2.filterSpeckles(patches, 0, _ISLAND_PX, round(_LOG_STEPS * _STEP))
    large = patches > 0
    return large if 2 * np.count_nonzero(large) >= np.count_nonzero(frame.valid) else frame.valid


def inverse(depth_m: Image, known: Mask) -> Image:
    """Inverse depth [1/m], 0 where it is not known.

    Inverse depth is what is averaged and smoothed: over the image of a plane it is linear, depth
    is not, and a stereo camera's noise is even in it.
    """
    out = np.zeros(known.shape, np.float32)
    np.divide(np.float32(1), depth_m, out=out, where=known)
    return out


def guide(frame: Frame, smoothing_px: float) -> NDArray[np.uint8]:
    """Image that tells where surfaces end, (h, w, 3), 8 bits.

    Args:
        frame: with an image; a dark one, as infrared is, is brought to a colour image's level.
        smoothing_px: of a Gaussian; a projector's dots are no edges and must go. 0 = none.
    """
    image = frame.rgb
    if smoothing_px > 0:
        image = np.asarray(cv2.GaussianBlur(image, (0, 0), smoothing_px), np.float32)
    gain = _LEVEL / max(float(image.mean()), 1e-6)
    return np.rint(255 * np.clip(image * gain, 0, 1)).astype(np.uint8)
