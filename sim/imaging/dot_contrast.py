"""Contrast of the projected dots in an infrared image."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from starling.sim.captures.png import GreyImage

_WINDOW_PX = 16  # Side of a window [px]. Dots are 6 px apart on a D415, about 14 px on a D435.
_DARKEST_DN = 2.0  # Below this mean signal, quantisation dominates a window [DN].


def dot_contrast(infrared: GreyImage, black_level_dn: float = 0.0) -> float:
    """Median over windows of the Michelson contrast (max - min) / (max + min).

    The image is cut into windows of 16 x 16 px that do not overlap. In each window, min and max
    are the 5th and 95th percentile of the signal above the black level. True extremes would
    measure the noise of single pixels. Dark windows (mean below 2 DN) are left out. Texture and
    noise contribute too, so the dots' own contribution is the difference to an image with the
    projector off.

    Args:
        infrared: (h, w).
        black_level_dn: pedestal of the image [DN].

    Returns:
        Contrast in [0, 1]; NaN if every window is dark.
    """
    windows = _windows(infrared.astype(np.float32) - np.float32(black_level_dn))
    windows = np.maximum(windows[windows.mean(axis=1) >= _DARKEST_DN], 0.0)
    if len(windows) == 0:
        return float("nan")
    low, high = np.percentile(windows, (5, 95), axis=1)
    return float(np.median((high - low) / (high + low)))


def _windows(image: NDArray[np.float32]) -> NDArray[np.float32]:
    """Cut (h, w) into (n, window^2); incomplete windows at the right and bottom are dropped."""
    size = min(_WINDOW_PX, *image.shape)
    rows, columns = (length // size for length in image.shape)
    cut = image[: rows * size, : columns * size].reshape(rows, size, columns, size)
    return cut.swapaxes(1, 2).reshape(rows * columns, size * size)
