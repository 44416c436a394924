"""Averaging of neighbouring pixels, as a device's rectification does by resampling."""

from __future__ import annotations

import cv2
import numpy as np

from starling.sim.arrays import Image


def smooth(signal: Image, sigma_px: float) -> Image:
    """Average with a Gaussian; 0 px is the identity.

    The variance of independent noise falls to 1 / (4 pi sigma^2) of its value (within 3 % for
    sigma >= 0.7 px, within 0.1 % for sigma >= 1 px). At distance d its correlation becomes
    exp(-d^2 / (4 sigma^2)).
    """
    if sigma_px == 0:
        return signal
    kernel = _kernel(sigma_px)
    averaged = cv2.sepFilter2D(signal, cv2.CV_32F, kernel, kernel, borderType=cv2.BORDER_REFLECT)
    return np.asarray(averaged, np.float32)


def variance_share(sigma_px: float) -> float:
    """Return the share of independent noise's variance left after averaging along one axis."""
    return 1.0 if sigma_px == 0 else float((_kernel(sigma_px).astype(np.float64) ** 2).sum())


def _kernel(sigma_px: float):
    reach = max(int(np.ceil(4 * sigma_px)), 1)
    return np.asarray(cv2.getGaussianKernel(2 * reach + 1, sigma_px, cv2.CV_32F))
