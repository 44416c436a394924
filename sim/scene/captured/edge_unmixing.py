"""Recovery of surface brightness from an image that was smoothed across depth edges."""

from __future__ import annotations

import cv2
import numpy as np

from starling.sim.arrays import Image
from starling.sim.stereo.filled import filled

_PASSES = 10  # Iterations; 20 give no visible change.
_WITHIN = 2 / 3  # Smoothing within surfaces, relative to that of the image.
_JUMP_PX = 2.0  # Disparity steps well above this separate surfaces; smaller slopes do not [px].
_DARKEST = 1e-4  # Least divisor, relative to the brightest pixel.


def unmix_edges(image: Image, disparity_px: Image, sigma_px: float) -> Image:
    """Undo the mixing of a Gaussian across depth edges; detail within surfaces stays lost.

    Richardson-Lucy deconvolution. After each iteration an edge-aware filter smooths within
    surfaces. Without the unmixing, a bright wall would brighten adjacent surfaces.

    Args:
        image: (h, w) >= 0, smoothed by a Gaussian of `sigma_px`.
        disparity_px: (h, w) reference, NaN where unknown; known somewhere.
        sigma_px: Sigma of the Gaussian [px].

    Returns:
        (h, w) >= 0 with jumps at depth edges. Smoothed again, it equals `image` to a few per cent.

    Source: Richardson, J. Opt. Soc. Am. 62, 1972, eq. 7; domain transform: Gastal and Oliveira,
    ACM Trans. Graph. 30 (SIGGRAPH 2011), normalised convolution.
    """
    filled_px = filled(disparity_px, np.isfinite(disparity_px))
    guide = np.ascontiguousarray(filled_px, np.float32)
    least = np.float32(_DARKEST * max(float(image.max()), 1e-30))
    estimate = image
    for _ in range(_PASSES):
        blurred = np.maximum(cv2.GaussianBlur(estimate, (0, 0), sigma_px), least)
        estimate = cv2.ximgproc.dtFilter(
            guide,
            np.asarray(estimate * (image / blurred), np.float32),
            _WITHIN * sigma_px,
            _JUMP_PX,
            mode=cv2.ximgproc.DTF_NC,
        )
    return np.asarray(np.maximum(estimate, 0), np.float32)
