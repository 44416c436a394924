"""Dequantisation: draw unquantised levels that an image may have been rounded from.

A change by less than half a DN is lost if it is applied to whole DN and rounded again. Moreover, no
camera removes quantisation noise. So effects are applied to levels, which are then rounded.
The most likely levels do not serve, because they lie near the middles of their codes. Levels are
drawn at random instead, from a Gaussian texture. Its power spectrum is the image's, less the
1/12 DN^2 of white quantisation noise (Bennett, Bell System Tech. J. 27(3), 1948).

In an area of one single code, only that code is known. Levels are therefore also shifted by a
smooth random field of up to half a DN, so that rounding gives other codes with equal noise.
"""

from __future__ import annotations

import itertools
import zlib

import cv2
import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy import special
from scipy.fft import fftfreq, irfft2, rfft2, rfftfreq

Image = NDArray[np.floating]

# Noise variance [DN^2]: quantisation, and the fine power of isolated dots that the spectrum of
# their tile does not describe.
_NOISE = 1 / 12 + 0.02
_TILE_PX = 32  # Side of the tiles of the local spectra.
_STEP_PX = _TILE_PX // 2  # Tiles overlap by half.
_FADE = np.sin(np.pi * (np.arange(_TILE_PX) + 0.5) / _TILE_PX)
_WINDOW = np.outer(_FADE, _FADE).astype(np.float32)  # Squares of overlapping windows sum to 1.
_WHITE = float(np.square(_WINDOW).sum())  # Power of white noise of 1 DN^2 in a windowed tile.
_LITTLE = 1e-6 * _WHITE  # Lower limit of a band's power.
_BANDS = 12  # Number of radial frequency bands.
_RADIUS = np.hypot(fftfreq(_TILE_PX)[:, None], rfftfreq(_TILE_PX)[None])  # Frequency [1 / px].
_BAND = np.minimum(_RADIUS / 0.5 * _BANDS, _BANDS - 1).astype(int)
_IN_BAND = np.eye(_BANDS, dtype=np.float32)[_BAND.ravel()]
_SMOOTH_PX = 8.0  # Sigma of the shift field, which must not look like texture.


def draw_levels(codes: NDArray) -> Image:
    """Draw levels that an image may have been rounded from.

    An unconditional draw with the image's power spectrum is corrected towards the observed codes by
    a Wiener filter (conditional simulation by kriging, Matheron's rule).

    Args:
        codes: (h, w) whole codes [DN]. The draw is seeded by the image, so it is reproducible.

    Returns:
        (h, w) [DN] float32.
    """
    rng = np.random.default_rng(zlib.crc32(codes.tobytes()))
    image = codes.astype(np.float32)
    texture, noise, field = (rng.standard_normal(image.shape, np.float32) for _ in range(3))
    (level, _), (error, _), (observed, means) = (
        _spectra(values) for values in (texture, noise, image)
    )
    power = np.maximum(_band_powers(observed) - _NOISE * _WHITE, _LITTLE)
    level *= np.sqrt(power / _WHITE)[..., _BAND]
    wiener = power / (power + _NOISE * _WHITE)
    level += wiener[..., _BAND] * (observed - level - np.float32(np.sqrt(_NOISE)) * error)
    return _merge(level, means, image.shape) + _shift_field(field)


def _spectra(image: Image) -> tuple[NDArray[np.complexfloating], Image]:
    """Compute spectra of tiles (rows, columns, h, w // 2 + 1) less their means, and the means."""
    padding = [(_STEP_PX, _STEP_PX + -side % _STEP_PX) for side in image.shape]
    tiles = sliding_window_view(np.pad(image, padding, mode="reflect"), _WINDOW.shape)
    tiles = tiles[::_STEP_PX, ::_STEP_PX]
    means = tiles.mean((2, 3), keepdims=True)
    return np.asarray(rfft2(_WINDOW * (tiles - means))), means


def _merge(spectra: NDArray, means: Image, shape: tuple[int, ...]) -> Image:
    """Overlap and add tiles to an image of the given shape."""
    tiles = _WINDOW * (np.asarray(irfft2(spectra, _WINDOW.shape)) + _WINDOW * means)
    total = np.zeros([(side + 1) * _STEP_PX for side in tiles.shape[:2]], np.float32)
    for row, column in itertools.product((0, 1), repeat=2):
        subset = tiles[row::2, column::2]  # Tiles that do not overlap each other.
        rows, columns = subset.shape[0] * _TILE_PX, subset.shape[1] * _TILE_PX
        place = np.s_[row * _STEP_PX :, column * _STEP_PX :]
        total[place][:rows, :columns] += subset.swapaxes(1, 2).reshape(rows, columns)
    return total[tuple(slice(_STEP_PX, _STEP_PX + side) for side in shape)]


def _band_powers(spectra: NDArray) -> Image:
    """Average the power of each tile's bands (rows, columns, band) over neighbouring tiles."""
    power = np.square(np.abs(spectra)).reshape(*spectra.shape[:2], -1) @ _IN_BAND
    return cv2.blur(power / _IN_BAND.sum(0), (3, 3))  # The periodogram of one tile is too noisy.


def _shift_field(field: Image) -> Image:
    """Map white noise to a smooth field, distributed uniformly from -0.5 to 0.5 DN."""
    smooth = cv2.GaussianBlur(field, (0, 0), _SMOOTH_PX)
    return special.ndtr(smooth / smooth.std()) - np.float32(0.5)
