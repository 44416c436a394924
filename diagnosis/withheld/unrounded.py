"""What an image of whole codes was before it was rounded, as far as it can be told.

Rounding adds white noise of 1/12 DN^2 (Bennett, Bell System Tech. J. 27(3), 1948), after all else.
An effect that acts before may neither blur nor stretch it, and noise that is added to whole codes
is rounded to nothing where it is weak. In an image of a device that averages its codes most of the
finest structure is this noise.

Where an image is even it stands on one code, and nothing tells where within. In the middle of it
none would be moved over its edge by a little, and all by half a code; so such places are dealt out.
"""

from __future__ import annotations

import itertools

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import special

from diagnosis.withheld import bands

_ROUNDING = 1 / 12  # Variance of the noise of whole codes [DN^2].
_HALF = 0.5 - 1e-6  # What it is off a code by at most, so that it rounds to that.
# Powers are told tile by tile, faded into each other: dots of bright places are not those of dark.
_TILE_PX = 64
_FADE = np.outer(np.hanning(_TILE_PX + 1)[:-1], np.hanning(_TILE_PX + 1)[:-1])
_EVEN_PX = 7  # Side of the square in which an image has to be even,
_SMOOTH_PX = 8.0  # and how smooth it is taken to be there: sigma of what is dealt out.
_LEVELS = 0x0C0D_E5  # Seed of where they lie within their codes: the same in every case.

Image = NDArray[np.float64]


def unrounded(codes: NDArray[np.integer], *, side: str) -> Image:
    """Take out of an image the power that rounding put in, frequency by frequency.

    Args:
        codes: (h, w) whole codes [DN].
        side: "left" or "right" imager; where even places lie within their codes is each one's own,
            as a matcher would see what both have in common.

    Returns:
        (h, w) [DN], which rounds to these codes.
    """
    image = codes.astype(np.float64)
    level = np.clip(_smooth(image), image - _HALF, image + _HALF)
    return level + _within(level, image, side)


def _smooth(image: Image) -> Image:
    """Keep of each tile's bands the share of their power that is not rounding's."""
    step = _TILE_PX // 2
    down, across = (side + -side % step for side in image.shape)
    more = ((step, step + down - image.shape[0]), (step, step + across - image.shape[1]))
    padded = np.pad(image, more, mode="reflect")
    total = np.zeros_like(padded)
    for row, column in itertools.product(range(0, down + 1, step), range(0, across + 1, step)):
        place = np.s_[row : row + _TILE_PX, column : column + _TILE_PX]
        tile = padded[place]
        faded = _FADE * (tile - tile.mean())
        power = np.maximum(bands.power(faded) / np.mean(_FADE**2), 1e-12)
        gain = np.sqrt(np.clip(1 - _ROUNDING / power, 0.0, 1.0))
        total[place] += _FADE * bands.filtered(tile, gain)
    return total[step : step + image.shape[0], step : step + image.shape[1]]


def _within(level: Image, codes: Image, side: str) -> Image:
    """Smooth offsets of even places, drawn evenly from what leaves all around within its code."""
    square = np.ones((_EVEN_PX, _EVEN_PX), np.uint8)
    even = cv2.dilate(codes, square) - cv2.erode(codes, square) <= 1
    below, above = (
        cv2.blur(cv2.erode(np.where(even, room, 0.0), square), square.shape)
        for room in (level - codes + _HALF, codes + _HALF - level)
    )
    rng = np.random.Generator(np.random.SFC64([_LEVELS, side == "right"]))
    field = cv2.GaussianBlur(rng.standard_normal(level.shape), (0, 0), _SMOOTH_PX)
    return special.ndtr(field / field.std()) * (below + above) - below
