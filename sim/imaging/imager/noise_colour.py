"""Correlation of temporal noise between neighbouring pixels, at equal variance.

A device that rectifies or scales its images mixes the noise of neighbours. Where it restores the
contrast, or where a shared amplifier couples the pixels, images stay sharp and only noise is
correlated. White noise is filtered by a discrete Gaussian of variance t and scaled to variance 1.
I are modified Bessel functions. At m columns and n rows the correlation is I_m(2t) I_n(2t) /
I_0(2t)^2. Adjacent pixels have I_1 / I_0.

Source: Lindeberg, IEEE TPAMI 12(3), 1990: two discrete Gaussians in a row are one; EMVA Standard
1288, release 4.0, whose spectrograms show noise that is not white.
"""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import optimize, special

from starling.sim.arrays import Image

_REACH = 4.0  # Range of the filter [standard deviations].


def draw(rng: np.random.Generator, shape: tuple[int, ...], correlation: float) -> Image:
    """Draw standard normal deviates (h, w) whose adjacent pixels correlate.

    Args:
        rng: random stream.
        shape: (h, w).
        correlation: of adjacent pixels along rows and along columns; 0 gives white noise.
    """
    if correlation == 0:
        return rng.standard_normal(shape, np.float32)
    line = weights(correlation)
    border = len(line) // 2
    height, width = shape
    white = rng.standard_normal((height + 2 * border, width + 2 * border), np.float32)
    mixed = cv2.sepFilter2D(white, cv2.CV_32F, line, line)
    inner = mixed[border : border + height, border : border + width]
    return np.ascontiguousarray(inner, np.float32)


@cache
def weights(correlation: float) -> NDArray[np.float32]:
    """Return the filter along one axis (2 n + 1,); its squares sum to 1."""
    if correlation == 0:
        return np.ones(1, np.float32)
    variance = _variance(correlation)
    reach = int(np.ceil(_REACH * np.sqrt(variance))) + 1
    line = special.ive(np.abs(np.arange(-reach, reach + 1)), variance)
    line = (line / np.sqrt((line**2).sum())).astype(np.float32)
    line.setflags(write=False)
    return line


def _variance(correlation: float) -> float:
    """Return the variance [px^2] of the discrete Gaussian that gives a correlation in (0, 1)."""

    def excess(variance: float) -> float:
        return special.ive(1, 2 * variance) / special.ive(0, 2 * variance) - correlation

    variance = optimize.brentq(excess, 0.0, 100.0)
    assert isinstance(variance, float)
    return variance
