"""Mosaic of colour filters: one colour per pixel, and the luminance that is interpolated from it.

The rows of `rggb` are R G R G ... and G B G B ..., from the image's first pixel. Bilinear
interpolation gives the missing colours. A device's own interpolation is unknown.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import cv2
import numpy as np

from starling.sim.arrays import Image
from starling.sim.sensor.imager import Mosaic

LUMA = (0.299, 0.587, 0.114)  # Rec. ITU-R BT.601-7, 2.5.1: shares of red, green and blue.
_RED, _GREEN, _BLUE = 0, 1, 2
_TILE = ((_RED, _GREEN), (_GREEN, _BLUE))


def sample(bands: Sequence[Image]) -> Image:
    """Return the light behind each pixel's filter (h, w).

    Args:
        bands: red, green and blue light (h, w); or one image, of grey light.
    """
    if len(bands) == 1:
        return bands[0]
    light = np.empty_like(bands[_GREEN])
    for y, x in np.ndindex(2, 2):
        light[y::2, x::2] = bands[_TILE[y][x]][y::2, x::2]
    return light


def luminance(signal: Image, mosaic: Mosaic) -> Image:
    """Interpolate the colours of a mosaic; return their luminance (h, w). `none` is the identity.

    A grey image of one level stays as it is.
    """
    if mosaic == "none":
        return signal
    result = np.empty_like(signal)
    for (y, x), weights in _kernels().items():  # Reflection at the border keeps the colours' order.
        mixed = cv2.filter2D(signal, cv2.CV_32F, weights, borderType=cv2.BORDER_REFLECT_101)
        result[y::2, x::2] = mixed[y::2, x::2]
    return result


@cache
def _kernels() -> dict[tuple[int, int], Image]:
    """Return the luminance's weights (3, 3) at each pixel of the tile, by row and column."""
    kernels = {}
    for y, x in np.ndindex(2, 2):
        weights = np.zeros((3, 3))
        for colour, share in enumerate(LUMA):
            near = [
                (j, i)
                for j, i in np.ndindex(3, 3)
                if _TILE[(y + j - 1) % 2][(x + i - 1) % 2] == colour
            ]
            # A pixel has its own colour; other colours are the mean of the nearest pixels.
            if (1, 1) in near:
                near = [(1, 1)]
            for place in near:
                weights[place] += share / len(near)
        kernels[y, x] = weights.astype(np.float32)
    return kernels
