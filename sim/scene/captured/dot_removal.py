"""Removal of the projector's dots from an infrared image; texture remains."""

from __future__ import annotations

import cv2
import numpy as np

from starling.sim.arrays import Image, Mask

_DOT_SIGMA_PX = 1.55  # FWHM of 3.4 to 3.9 px, as measured on the D415 [px].
_ROUNDNESS = 0.45  # Least ratio of a dot's two curvatures; stripes and letters have smaller ones.
_ROUNDS = 4  # Passes over the residual, since dots overlap.


def remove_dots(level: Image) -> Image:
    """Subtract round Gaussian spots, detected by curvature and fitted over a local plane.

    Args:
        level: (h, w) linear image with dots.

    Returns:
        (h, w) image without dots; weak and even projector light remains.
    """
    spot, fit = _spot_and_fit()
    rest = level
    for _ in range(_ROUNDS):
        amplitude = np.where(_round_peaks(rest), cv2.filter2D(rest, -1, fit), 0)
        rest = rest - cv2.filter2D(np.maximum(amplitude, 0).astype(np.float32), -1, spot)
    # The median removes pits that remain where a spot was off its pixel centre.
    return np.asarray(cv2.medianBlur(rest, 3), np.float32)


def _spot_and_fit() -> tuple[Image, Image]:
    """The spot (9, 9), and the least-squares filter of its height over a local plane."""
    axis = np.arange(-4, 5, dtype=np.float64)
    x, y = np.meshgrid(axis, axis)
    spot = np.exp(-(x**2 + y**2) / (2 * _DOT_SIGMA_PX**2))
    columns = np.stack([spot.ravel(), np.ones(81), x.ravel(), y.ravel()], axis=1)
    fit = np.linalg.pinv(columns)[0].reshape(9, 9)
    return spot.astype(np.float32), fit.astype(np.float32)


def _round_peaks(image: Image) -> Mask:
    """Maxima of the negative curvature with similar curvature in all directions."""
    smooth = cv2.GaussianBlur(image, (0, 0), 1.0)
    xx = cv2.Sobel(smooth, cv2.CV_32F, 2, 0, ksize=3)
    yy = cv2.Sobel(smooth, cv2.CV_32F, 0, 2, ksize=3)
    xy = cv2.Sobel(smooth, cv2.CV_32F, 1, 1, ksize=3)
    mean, spread = -(xx + yy) / 2, np.sqrt(((xx - yy) / 2) ** 2 + xy**2)
    weaker, stronger = mean - spread, mean + spread
    peak = mean >= cv2.dilate(mean, np.ones((3, 3), np.uint8))
    return peak & (weaker > _ROUNDNESS * stronger) & (weaker > 0)
