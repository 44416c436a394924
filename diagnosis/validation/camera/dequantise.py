"""Estimates of the image before quantisation (dequantisation).

Quantisation adds white noise of 1/12 DN^2 (Bennett, Bell System Tech. J. 27(3), 1948) after all
other steps. An effect that acts earlier in the chain must neither blur nor amplify this noise. Weak
noise added to integer codes would also vanish when the codes are rounded. If a device averages its
codes, this noise dominates the finest structure of its images.

A dequantised value lies near the centre of its code, where weak noise never crosses a rounding
edge. A smooth field of fractions of a code is therefore added to the image (`subcode_offsets`). The
share of pixels near an edge then does not depend on how an effect changes the levels.
"""

from __future__ import annotations

import itertools
from functools import lru_cache

import cv2
import numpy as np
from numpy import fft
from numpy.typing import NDArray
from scipy import special

from starling.diagnosis.validation.camera.psf import Image

_BANDS = 32  # Number of bands: rings of equal width in radial frequency.
_ROUNDING = 1 / 12  # Variance of quantisation noise [DN^2].
_HALF = 0.5 - 1e-6  # Largest distance from the code [DN]; the result still rounds to it.
# Power is estimated in overlapping tiles, because dots differ between bright and dark regions.
_TILE_PX = 64
_WINDOW = np.outer(np.hanning(_TILE_PX + 1)[:-1], np.hanning(_TILE_PX + 1)[:-1])
_SMOOTH_PX = 16.0  # Gaussian sigma of the offsets [px]; a smooth field adds no texture.
_OFFSET_SEED = 0x0C0D_E5  # The same for all cases and for the pairs without effects.


def dequantise(codes: NDArray[np.integer]) -> Image:
    """Remove the power of quantisation noise from an image, band by band (Wiener-like gain).

    Args:
        codes: Integer codes (h, w) [DN].

    Returns:
        Image (h, w) [DN] that rounds to `codes`.
    """
    image = codes.astype(np.float64)
    return np.clip(_smooth(image), image - _HALF, image + _HALF)


def subcode_offsets(shape: tuple[int, int], *, side: str) -> Image:
    """Draw a smooth field of offsets, uniform in -0.5 to 0.5 DN.

    Args:
        shape: (h, w).
        side: "left" or "right". Each imager has its own field, because a matcher would match a
            common one.
    """
    rng = np.random.Generator(np.random.SFC64([_OFFSET_SEED, side == "right"]))
    field = cv2.GaussianBlur(rng.standard_normal(shape), (0, 0), _SMOOTH_PX)
    return special.ndtr(field / field.std()) - 0.5


def _smooth(image: Image) -> Image:
    """Scale each band of each tile to its power without quantisation noise."""
    step = _TILE_PX // 2
    down, across = (side + -side % step for side in image.shape)
    margin = ((step, step + down - image.shape[0]), (step, step + across - image.shape[1]))
    padded = np.pad(image, margin, mode="reflect")
    total = np.zeros_like(padded)
    for row, column in itertools.product(range(0, down + 1, step), range(0, across + 1, step)):
        place = np.s_[row : row + _TILE_PX, column : column + _TILE_PX]
        tile = padded[place]
        windowed = _WINDOW * (tile - tile.mean())
        power = np.maximum(band_power(windowed) / np.mean(_WINDOW**2), 1e-12)
        gain = np.sqrt(np.clip(1 - _ROUNDING / power, 0.0, 1.0))
        total[place] += _WINDOW * filter_bands(tile, gain)
    return total[step : step + image.shape[0], step : step + image.shape[1]]


def band_power(image: Image) -> Image:
    """Return the mean power of each band.

    The unit is the per-pixel variance of white noise with the same spectral density.

    Args:
        image: Image (h, w).

    Returns:
        Power (32,), from the coarsest to the finest band.
    """
    band = _band(image.shape)
    squared = np.abs(fft.rfft2(image - image.mean())) ** 2 / image.size
    total = np.bincount(band.ravel(), squared.ravel(), _BANDS)
    return total / np.maximum(np.bincount(band.ravel(), minlength=_BANDS), 1)


def filter_bands(image: Image, gain: Image) -> Image:
    """Multiply each band of an image (h, w) by its gain. The mean stays unchanged."""
    mean = image.mean()
    spectrum = fft.rfft2(image - mean) * gain[_band(image.shape)]
    return np.asarray(fft.irfft2(spectrum, image.shape)) + mean


@lru_cache(maxsize=2)  # Consecutive tiles of an image share their shape.
def _band(shape: tuple[int, ...]) -> NDArray[np.int64]:
    down, across = fft.fftfreq(shape[0]), fft.rfftfreq(shape[1])
    fineness = np.hypot(down[:, None], across[None, :])
    return np.minimum(fineness / fineness.max() * _BANDS, _BANDS - 1).astype(np.int64)
