"""Functions shared by the classical methods: trusted pixels, guide image and result."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.learning.completion.frame import CompletionFrame, Image, Mask
from starling.learning.completion.method import Completed, unknown_sigma

_LEVEL = 0.45  # Mean that the image is scaled to, a usual target of a colour camera's exposure.
_ISLAND_PX = 400  # Patches of depth up to this area are not extended [px].
_STEP = 0.05  # Ratio of neighbouring depths, less 1, that separates two patches.
_LOG_STEPS = 1000  # Quantisation of a patch's depth: steps per unit of its natural logarithm.


def completed(frame: CompletionFrame, filled_m: NDArray[np.floating]) -> Completed:
    """Keep the camera's depth bit for bit and fill the other pixels.

    These methods do not estimate their error, so that sigma is NaN.
    """
    depth = np.where(frame.valid, frame.depth_m, filled_m).astype(np.float32)
    return Completed(depth_m=depth, sigma_m=unknown_sigma(frame))


def trusted(frame: CompletionFrame) -> Mask:
    """Return the valid pixels (h, w) that holes are filled from.

    Small isolated patches with a different depth are mostly false matches, which would spread over
    the whole hole. If most of the depth is in small patches, as with scattered points, all is
    trusted.
    """
    log = np.log(np.where(frame.valid, frame.depth_m, np.float32(1)))
    code = np.where(frame.valid, _LOG_STEPS * (log - log.min()) + 1, 0)
    patches = np.minimum(code, np.iinfo(np.int16).max).astype(np.int16)
    cv2.filterSpeckles(patches, 0, _ISLAND_PX, round(_LOG_STEPS * _STEP))
    large = patches > 0
    return large if 2 * np.count_nonzero(large) >= np.count_nonzero(frame.valid) else frame.valid


def inverse(depth_m: Image, known: Mask) -> Image:
    """Inverse depth [1/m], 0 where unknown.

    Inverse depth is averaged and smoothed because it is linear over the image of a plane. A stereo
    camera's noise is uniform in it.
    """
    out = np.zeros(known.shape, np.float32)
    np.divide(np.float32(1), depth_m, out=out, where=known)
    return out


def guide(frame: CompletionFrame, smoothing_px: float) -> NDArray[np.uint8]:
    """Return the image (h, w, 3) that marks the edges of surfaces, 8 bits.

    Args:
        frame: frame with an image; dark (infrared) images are scaled to a colour image's level.
        smoothing_px: sigma of the Gaussian that removes the projector's dots. 0 = none.
    """
    image = frame.rgb
    if smoothing_px > 0:
        image = np.asarray(cv2.GaussianBlur(image, (0, 0), smoothing_px), np.float32)
    gain = _LEVEL / max(float(image.mean()), 1e-6)
    return np.rint(255 * np.clip(image * gain, 0, 1)).astype(np.uint8)
