"""Power of an image by how fine its structures are, and filters that are told by it."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy import fft
from numpy.typing import NDArray

_COUNT = 32  # Rings of radial frequency.

Image = NDArray[np.float64]


def power(image: Image) -> NDArray[np.float64]:
    """Variance per pixel that white noise of each band's power would have.

    Args:
        image: (h, w).

    Returns:
        One for each band, from coarse to fine.
    """
    band = _band(image.shape)
    squared = np.abs(fft.rfft2(image - image.mean())) ** 2 / image.size
    total = np.bincount(band.ravel(), squared.ravel(), _COUNT)
    return total / np.maximum(np.bincount(band.ravel(), minlength=_COUNT), 1)


def filtered(image: Image, gain: NDArray[np.float64]) -> Image:
    """Multiply each band of an image (h, w) by a factor; its mean stays."""
    mean = image.mean()
    spectrum = fft.rfft2(image - mean) * gain[_band(image.shape)]
    return np.asarray(fft.irfft2(spectrum, image.shape)) + mean


@lru_cache(maxsize=2)  # Tiles of one image are asked for one after the other.
def _band(shape: tuple[int, ...]) -> NDArray[np.int64]:
    down, across = fft.fftfreq(shape[0]), fft.rfftfreq(shape[1])
    fineness = np.hypot(down[:, None], across[None, :])
    return np.minimum(fineness / fineness.max() * _COUNT, _COUNT - 1).astype(np.int64)
