"""Averaging: what a device's resampling by rectification does to signal and noise."""

from __future__ import annotations

import cv2
import numpy as np

from starling.sim.render.layers import Image


def smoothed(signal: Image, sigma_px: float) -> Image:
    """Average by a Gaussian; 0 px is the identity.

    Independent noise of variance 1 keeps 1 / (4 pi sigma^2) (to 3 % from 0.7 px, to 0.1 % from
    1 px on) and is then correlated over a distance d by exp(-d^2 / (4 sigma^2)).
    """
    if sigma_px == 0:
        return signal
    kernel = _kernel(sigma_px)
    averaged = cv2.sepFilter2D(signal, cv2.CV_32F, kernel, kernel, borderType=cv2.BORDER_REFLECT)
    return np.asarray(averaged, np.float32)


def kept(sigma_px: float) -> float:
    """Share of independent noise's variance that averaging along one axis keeps."""
    return 1.0 if sigma_px == 0 else float((_kernel(sigma_px).astype(np.float64) ** 2).sum())


def _kernel(sigma_px: float):
    reach = max(int(np.ceil(4 * sigma_px)), 1)
    return np.asarray(cv2.getGaussianKernel(2 * reach + 1, sigma_px, cv2.CV_32F))
