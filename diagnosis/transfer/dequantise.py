"""Levels as those that an image's whole codes may have been rounded from.

What adds less than half a code to whole codes is rounded to nothing, and what takes away rounding's
noise no camera does: so effects act on levels, which are rounded again. The likeliest levels would
not do, as they lie near the middles of their codes. They are drawn instead, from all that have the
image's powers, band by band, less the 1/12 DN^2 of white noise that rounding adds (Bennett, Bell
System Tech. J. 27(3), 1948).

Of an image that stands on one code nothing but that is known. So levels are moved by shares of a
code, others from place to place: rounded anew they are other codes, as noisy.
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

# Variance of what is taken for noise [DN^2]: that of rounding, and as much as dots have of fine
# power that is none of their tile's elsewhere.
_NOISE = 1 / 12 + 0.02
_TILE_PX = 32  # In which powers are told, half of it over the next:
_STEP_PX = _TILE_PX // 2
_FADE = np.sin(np.pi * (np.arange(_TILE_PX) + 0.5) / _TILE_PX)
_WINDOW = np.outer(_FADE, _FADE).astype(np.float32)  # its squares add up to 1,
_WHITE = float(np.square(_WINDOW).sum())  # and the power of white noise of 1 DN^2 in it.
_LITTLE = 1e-6 * _WHITE
_BANDS = 12  # Of a tile, by how fine they are.
_RADIUS = np.hypot(fftfreq(_TILE_PX)[:, None], rfftfreq(_TILE_PX)[None])  # [1 / px]
_BAND = np.minimum(_RADIUS / 0.5 * _BANDS, _BANDS - 1).astype(int)
_IN_BAND = np.eye(_BANDS, dtype=np.float32)[_BAND.ravel()]
_SMOOTH_PX = 8.0  # Sigma of the shares, so that they are no texture.


def levels(codes: NDArray) -> Image:
    """Draw levels that an image may have been rounded from, and move them by shares of a code.

    Whole codes tell of a level as values tell that noise was added to: they are a draw that knows
    of the powers alone, and what codes lack of it, as far as that is told from noise (Matheron's
    rule).

    Args:
        codes: (h, w) whole codes [DN]; what is drawn is each image's own, and the same each time.

    Returns:
        (h, w) [DN] float32.
    """
    rng = np.random.default_rng(zlib.crc32(codes.tobytes()))
    image = codes.astype(np.float32)
    drawn, noise, field = (rng.standard_normal(image.shape, np.float32) for _ in range(3))
    (level, _), (off, _), (own, means) = (_spectra(one) for one in (drawn, noise, image))
    power = np.maximum(_powers(own) - _NOISE * _WHITE, _LITTLE)
    level *= np.sqrt(power / _WHITE)[..., _BAND]
    told = power / (power + _NOISE * _WHITE)
    level += told[..., _BAND] * (own - level - np.float32(np.sqrt(_NOISE)) * off)
    return _merged(level, means, image.shape) + _shares(field)


def _spectra(image: Image) -> tuple[NDArray[np.complexfloating], Image]:
    """Of each tile (down, across, h, w // 2 + 1) less its mean, and that."""
    more = [(_STEP_PX, _STEP_PX + -side % _STEP_PX) for side in image.shape]
    tiles = sliding_window_view(np.pad(image, more, mode="reflect"), _WINDOW.shape)
    tiles = tiles[::_STEP_PX, ::_STEP_PX]
    means = tiles.mean((2, 3), keepdims=True)
    return np.asarray(rfft2(_WINDOW * (tiles - means))), means


def _merged(spectra: NDArray, means: Image, shape: tuple[int, ...]) -> Image:
    """Of what shape their image is."""
    parts = _WINDOW * (np.asarray(irfft2(spectra, _WINDOW.shape)) + _WINDOW * means)
    total = np.zeros([(side + 1) * _STEP_PX for side in parts.shape[:2]], np.float32)
    for down, across in itertools.product((0, 1), repeat=2):
        one = parts[down::2, across::2]
        rows, columns = one.shape[0] * _TILE_PX, one.shape[1] * _TILE_PX
        place = np.s_[down * _STEP_PX :, across * _STEP_PX :]
        total[place][:rows, :columns] += one.swapaxes(1, 2).reshape(rows, columns)
    return total[tuple(slice(_STEP_PX, _STEP_PX + side) for side in shape)]


def _powers(spectra: NDArray) -> Image:
    """Of each tile's bands (down, across, band)."""
    power = np.square(np.abs(spectra)).reshape(*spectra.shape[:2], -1) @ _IN_BAND
    return cv2.blur(power / _IN_BAND.sum(0), (3, 3))  # A tile's own is much by chance.


def _shares(field: Image) -> Image:
    """Smooth shares of a code, evenly from half of one below to half of one above."""
    smooth = cv2.GaussianBlur(field, (0, 0), _SMOOTH_PX)
    return special.ndtr(smooth / smooth.std()) - np.float32(0.5)
