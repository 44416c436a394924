"""Where levels lie within the whole codes they were rounded to, as far as an image tells.

What adds less than half a code to whole codes is rounded to nothing. So noise is added to levels,
which are rounded again. Rounding added white noise of 1/12 DN^2 (Bennett, Bell System Tech. J.
27(3), 1948): each band of an image has as much less. Where an image stands on one code all around,
no more is known than that; levels are drawn there, smoothly, from all that the code leaves.
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

_ROUNDING = 1 / 12  # [DN^2]
_HALF = np.float32(0.499)
_TILE_PX = 32  # In which powers are told, half of it over the next:
_STEP_PX = _TILE_PX // 2
_FADE = np.sin(np.pi * (np.arange(_TILE_PX) + 0.5) / _TILE_PX)
_WINDOW = np.outer(_FADE, _FADE).astype(np.float32)  # its squares add up to 1,
_NOISE = _ROUNDING * float(np.square(_WINDOW).sum())  # and the power of rounding in it.
_BANDS = 12  # Of a tile, by how fine they are.
_RADIUS = np.hypot(fftfreq(_TILE_PX)[:, None], rfftfreq(_TILE_PX)[None])  # [1 / px]
_BAND = np.minimum(_RADIUS / 0.5 * _BANDS, _BANDS - 1).astype(int)
_IN_BAND = np.eye(_BANDS, dtype=np.float32)[_BAND.ravel()]
_EVEN_PX = 7  # Side of the square in which an image has to be even.
_SMOOTH_PX = 8.0  # Sigma of what is drawn.


def levels(codes: NDArray) -> Image:
    """Take out of an image what rounding put in.

    Args:
        codes: (h, w) whole codes [DN]; what is drawn is each image's own, and the same each time.

    Returns:
        (h, w) [DN] float32, which rounds to these codes.
    """
    image = codes.astype(np.float32)
    level = np.clip(_without_rounding(image), image - _HALF, image + _HALF)
    return level + _drawn(level, image)


def _without_rounding(image: Image) -> Image:
    """Keep of each tile's bands the share of their power that is not rounding's."""
    more = [(_STEP_PX, _STEP_PX + -side % _STEP_PX) for side in image.shape]
    tiles = sliding_window_view(np.pad(image, more, mode="reflect"), _WINDOW.shape)
    tiles = tiles[::_STEP_PX, ::_STEP_PX]
    means = tiles.mean((2, 3), keepdims=True)
    spectra = np.asarray(rfft2(_WINDOW * (tiles - means)))
    power = np.square(np.abs(spectra)).reshape(*tiles.shape[:2], -1) @ _IN_BAND
    power = cv2.blur(power / _IN_BAND.sum(0), (3, 3))  # A tile's own is much by chance.
    kept = np.sqrt(np.clip(1 - _NOISE / np.maximum(power, _NOISE), 0.0, None))
    spectra *= kept[..., _BAND]
    parts = _WINDOW * (irfft2(spectra, _WINDOW.shape) + _WINDOW * means)
    total = np.zeros([side + sum(pad) for side, pad in zip(image.shape, more, strict=True)])
    for down, across in itertools.product((0, 1), repeat=2):
        one = parts[down::2, across::2]
        rows, columns = one.shape[0] * _TILE_PX, one.shape[1] * _TILE_PX
        place = np.s_[down * _STEP_PX :, across * _STEP_PX :]
        total[place][:rows, :columns] += one.swapaxes(1, 2).reshape(rows, columns)
    inside = tuple(slice(_STEP_PX, _STEP_PX + side) for side in image.shape)
    return total[inside].astype(np.float32)


def _drawn(level: Image, codes: Image) -> Image:
    """Smooth offsets where an image is even, from what leaves all around within its code."""
    square = np.ones((_EVEN_PX, _EVEN_PX), np.uint8)
    even = cv2.dilate(codes, square) - cv2.erode(codes, square) <= 1
    below, above = (
        cv2.blur(cv2.erode(np.where(even, room, np.float32(0)), square), square.shape)
        for room in (level - codes + _HALF, codes + _HALF - level)
    )
    return _shares(codes) * (below + above) - below


def _shares(codes: Image) -> Image:
    """Smooth, and evenly from 0 to 1; one for all images would tip the same codes in every room."""
    rng = np.random.default_rng(zlib.crc32(codes.tobytes()))
    field = rng.standard_normal(codes.shape).astype(np.float32)
    smooth = _blurred(field, _SMOOTH_PX)
    return special.ndtr(smooth / smooth.std())


def _blurred(image: NDArray[np.float32], sigma_px: float) -> NDArray:
    return cv2.GaussianBlur(image, (0, 0), sigma_px)
