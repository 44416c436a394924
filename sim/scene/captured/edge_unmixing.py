"""Brightness of surfaces from an image smoothed across their edges."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.sim.stereo.filled import filled

Array = NDArray[np.float32]

_PASSES = 10  # Twice as many change nothing that is seen.
_WITHIN = 2 / 3  # Smoothing within surfaces, as a part of that of the image.
_JUMP_PX = 2.0  # Steps of disparity far above it part surfaces; slopes below it do not.
_DARKEST = 1e-4  # Share of the brightest that a division is at least by.


def unmixed(image: Array, disparity_px: Array, sigma_px: float) -> Array:
    """Undo what a Gaussian mixed across depth edges; within a surface detail stays lost.

    Richardson-Lucy deconvolution, held smooth within surfaces after each pass by a filter that
    stops where disparity jumps. Without it a bright wall shines on what is seen beside it.

    Args:
        image: (h, w) >= 0, smoothed by a Gaussian of `sigma_px`.
        disparity_px: (h, w) reference, NaN where unknown; known somewhere.
        sigma_px: of the Gaussian.

    Returns:
        (h, w) >= 0 with jumps where the surface has them; smoothed again, it is `image` to a few
        per cent.

    Source: Richardson, J. Opt. Soc. Am. 62, 1972, eq. 7; domain transform: Gastal and Oliveira,
    ACM Trans. Graph. 30 (SIGGRAPH 2011), normalised convolution.
    """
    whole_px = filled(disparity_px, np.isfinite(disparity_px))
    guide = np.ascontiguousarray(whole_px, np.float32)
    least = np.float32(_DARKEST * max(float(image.max()), 1e-30))
    found = image
    for _ in range(_PASSES):
        again = np.maximum(cv2.GaussianBlur(found, (0, 0), sigma_px), least)
        found = cv2.ximgproc.dtFilter(
            guide,
            np.asarray(found * (image / again), np.float32),
            _WITHIN * sigma_px,
            _JUMP_PX,
            mode=cv2.ximgproc.DTF_NC,
        )
    return np.asarray(np.maximum(found, 0), np.float32)
