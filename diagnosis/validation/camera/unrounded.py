"""What an image of whole codes was before it was rounded, as far as it can be told.

Rounding adds white noise of 1/12 DN^2 (Bennett, Bell System Tech. J. 27(3), 1948), after all else.
An effect that acts before may neither blur nor stretch it, and noise that is added to whole codes
is rounded to nothing where it is weak. In an image of a device that averages its codes most of the
finest structure is this noise.

What is told so lies near the middles of its codes. There a little noise moves nothing over an edge,
and at an edge all of it does. So images are made brighter or darker by a share of a code, another
from place to place: then the same part of them is near an edge whatever an effect does to levels.
"""

from __future__ import annotations

import itertools

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import special

from starling.diagnosis.validation.camera import bands

_ROUNDING = 1 / 12  # Variance of the noise of whole codes [DN^2].
_HALF = 0.5 - 1e-6  # What it is off a code by at most, so that it rounds to that.
# Powers are told tile by tile, faded into each other: dots of bright places are not those of dark.
_TILE_PX = 64
_FADE = np.outer(np.hanning(_TILE_PX + 1)[:-1], np.hanning(_TILE_PX + 1)[:-1])
_SMOOTH_PX = 16.0  # Sigma of the shares, so that they are no texture.
_SHARES = 0x0C0D_E5  # Their seed: the same in every case, and in pairs without effects.

Image = NDArray[np.float64]


def unrounded(codes: NDArray[np.integer]) -> Image:
    """Take out of an image the power that rounding put in, frequency by frequency.

    Args:
        codes: (h, w) whole codes [DN].

    Returns:
        (h, w) [DN], which rounds to these codes.
    """
    image = codes.astype(np.float64)
    return np.clip(_smooth(image), image - _HALF, image + _HALF)


def shares(shape: tuple[int, int], *, side: str) -> Image:
    """Draw smooth shares of a code, evenly from half of one below to half of one above.

    Args:
        shape: (h, w).
        side: "left" or "right" imager; each has its own, as a matcher would see what both have in
            common.
    """
    rng = np.random.Generator(np.random.SFC64([_SHARES, side == "right"]))
    field = cv2.GaussianBlur(rng.standard_normal(shape), (0, 0), _SMOOTH_PX)
    return special.ndtr(field / field.std()) - 0.5


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
