"""Take the projector's dots out of an infrared image and leave the texture."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float32]

_DOT_SIGMA_PX = 1.55  # 3.4 to 3.9 px full width at half maximum, as measured on the D415.
_ROUNDNESS = 0.45  # Least ratio of a dot's two curvatures; stripes and letters have less.
_ROUNDS = 4  # Dots overlap: what is left after one round is searched again.


def removed(level: Array) -> Array:
    """Subtract round Gaussian spots, found by their curvature and fitted on a local plane.

    Args:
        level: (h, w) linear image with dots.

    Returns:
        (h, w), the image as if the projector had lit it evenly and weakly.
    """
    spot, fit = _spot_and_fit()
    rest = level
    for _ in range(_ROUNDS):
        amplitude = np.where(_round_peaks(rest), cv2.filter2D(rest, -1, fit), 0)
        rest = rest - cv2.filter2D(np.maximum(amplitude, 0).astype(np.float32), -1, spot)
    # Pits are left where a spot was a little off its pixel.
    return np.asarray(cv2.medianBlur(rest, 3), np.float32)


def _spot_and_fit() -> tuple[Array, Array]:
    """The spot (9, 9), and the filter that fits its height beside a plane by least squares."""
    axis = np.arange(-4, 5, dtype=np.float64)
    x, y = np.meshgrid(axis, axis)
    spot = np.exp(-(x**2 + y**2) / (2 * _DOT_SIGMA_PX**2))
    columns = np.stack([spot.ravel(), np.ones(81), x.ravel(), y.ravel()], axis=1)
    fit = np.linalg.pinv(columns)[0].reshape(9, 9)
    return spot.astype(np.float32), fit.astype(np.float32)


def _round_peaks(image: Array) -> NDArray[np.bool_]:
    """Maxima of the curvature that curve down alike in all directions."""
    smooth = cv2.GaussianBlur(image, (0, 0), 1.0)
    xx = cv2.Sobel(smooth, cv2.CV_32F, 2, 0, ksize=3)
    yy = cv2.Sobel(smooth, cv2.CV_32F, 0, 2, ksize=3)
    xy = cv2.Sobel(smooth, cv2.CV_32F, 1, 1, ksize=3)
    mean, spread = -(xx + yy) / 2, np.sqrt(((xx - yy) / 2) ** 2 + xy**2)
    weaker, stronger = mean - spread, mean + spread
    peak = mean >= cv2.dilate(mean, np.ones((3, 3), np.uint8))
    return peak & (weaker > _ROUNDNESS * stronger) & (weaker > 0)
