"""What an image of whole codes was before it was rounded, as far as it can be told.

Rounding adds white noise of 1/12 DN^2 (Bennett, Bell System Tech. J. 27(3), 1948), after all else.
An effect that acts before may neither blur nor stretch it, and noise that is added to whole codes
is rounded to nothing where it is weak. In an image of a device that averages its codes most of the
finest structure is this noise.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from diagnosis.withheld import bands

_ROUNDING = 1 / 12  # Variance of the noise of whole codes [DN^2].
_HALF = 0.5 - 1e-6  # What it is off a code by at most, so that it rounds to that.
_BORDER_PX = 16  # Mirrored, as a spectrum takes an image to go on at its other side.


def unrounded(codes: NDArray[np.integer]) -> NDArray[np.float64]:
    """Take out of an image the power that rounding put in, frequency by frequency.

    Args:
        codes: (h, w) whole codes [DN].

    Returns:
        (h, w) [DN], which rounds to these codes.
    """
    image = np.pad(codes.astype(np.float64), _BORDER_PX, mode="reflect")
    power = np.maximum(bands.power(image), 1e-12)
    smooth = bands.filtered(image, np.sqrt(np.clip(1 - _ROUNDING / power, 0.0, 1.0)))
    inner = slice(_BORDER_PX, -_BORDER_PX)
    return np.clip(smooth, image - _HALF, image + _HALF)[inner, inner]
