"""Power of an image in bands of radial frequency, and filters with one gain per band."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy import fft
from numpy.typing import NDArray

_COUNT = 32  # Number of bands: rings of equal width in radial frequency.

Image = NDArray[np.float64]


def power(image: Image) -> NDArray[np.float64]:
    """Return the mean power of each band.

    The unit is the per-pixel variance of white noise with the same spectral density.

    Args:
        image: Image (h, w).

    Returns:
        Power (32,), from the coarsest to the finest band.
    """
    band = _band(image.shape)
    squared = np.abs(fft.rfft2(image - image.mean())) ** 2 / image.size
    total = np.bincount(band.ravel(), squared.ravel(), _COUNT)
    return total / np.maximum(np.bincount(band.ravel(), minlength=_COUNT), 1)


def filtered(image: Image, gain: NDArray[np.float64]) -> Image:
    """Multiply each band of an image (h, w) by its gain. The mean stays unchanged."""
    mean = image.mean()
    spectrum = fft.rfft2(image - mean) * gain[_band(image.shape)]
    return np.asarray(fft.irfft2(spectrum, image.shape)) + mean


@lru_cache(maxsize=2)  # Consecutive tiles of an image share their shape.
def _band(shape: tuple[int, ...]) -> NDArray[np.int64]:
    down, across = fft.fftfreq(shape[0]), fft.rfftfreq(shape[1])
    fineness = np.hypot(down[:, None], across[None, :])
    return np.minimum(fineness / fineness.max() * _COUNT, _COUNT - 1).astype(np.int64)
