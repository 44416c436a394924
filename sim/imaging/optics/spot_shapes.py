"""Shapes of the lens's spot: a disc and exponential tails, of exact variance on the pixels.

A round aperture out of focus gives a disc. Scatter in glass and coatings gives a bright core with
tails; here the light falls as exp(-r / a). At one variance s^2 the disc has the radius 2 s, and
a = s / sqrt(3). Excess kurtosis along an axis: disc -1, Gaussian 0, exponential 2. Mixtures of
spots of one variance have that variance, and kurtosis in proportion to their shares.

Source: disc: Potmesil and Chakravarty, ACM TOG 1(2), 1982; tails: Moffat, Astron. Astrophys. 3
(1969) 455, whose profiles this one is a limit of: finite in variance, and without a free power.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

_REACH = 8.0  # Range of the tails [standard deviations]; beyond lies 0.05 % of the variance.
_FINE = 7  # Samples of a disc's rim across a pixel.
_WIDE_PX = 8.0  # Discs of a larger sigma are sampled once a pixel.

Kernel = NDArray[np.float32]


def mixed(gaussian: Kernel, variance_px2: float, shape: float) -> Kernel:
    """Return a spot (k, k) of unit sum.

    Args:
        gaussian: (2 n + 1,) weights of the Gaussian along one axis.
        variance_px2: variance of every part of the spot along each axis [px^2].
        shape: -1 for a disc, 0 for a Gaussian, 1 for exponential tails; between them, the share
            |shape| of the light lies in the disc or the tails.
    """
    across = gaussian.astype(np.float64)
    parts = [((1 - abs(shape)) * np.outer(across, across)), abs(shape) * _part(variance_px2, shape)]
    side = max(map(len, parts))
    padded = [np.pad(part, (side - len(part)) // 2) for part in parts]
    return np.asarray(padded[0] + padded[1], np.float32)


def _part(variance_px2: float, shape: float) -> NDArray[np.float64]:
    if variance_px2 == 0:
        return np.ones((1, 1))
    return disc(variance_px2) if shape < 0 else tails(variance_px2)


@lru_cache(maxsize=64)
def disc(variance_px2: float) -> NDArray[np.float64]:
    """Return a disc (k, k) of unit sum, averaged over the pixels.

    Pixels widen a disc, so its radius is the one whose averages have the variance.
    """
    sigma = math.sqrt(variance_px2)
    radius = math.ceil(2 * sigma) + 1
    fine = _FINE if sigma < _WIDE_PX else 1
    width = optimize.brentq(
        lambda radius_px: _variance(_covered(radius_px, radius, fine)) - variance_px2,
        *(0.5 / fine, 2 * sigma + 1),
        xtol=1e-9,
    )
    assert isinstance(width, float)
    spot = _covered(width, radius, fine)
    spot.setflags(write=False)
    return spot


def _covered(radius_px: float, reach: int, fine: int) -> NDArray[np.float64]:
    """Share of a disc's light in each pixel; the rim is linear across a sample."""
    place = (np.arange((2 * reach + 1) * fine) - ((2 * reach + 1) * fine - 1) / 2) / fine
    inside = np.clip((radius_px - np.hypot(place[:, None], place)) * fine + 0.5, 0, 1)
    pixels = inside.reshape(2 * reach + 1, fine, 2 * reach + 1, fine).sum(axis=(1, 3))
    return pixels / pixels.sum()


def _variance(spot: NDArray[np.float64]) -> float:
    place = np.arange(len(spot)) - len(spot) // 2
    return float(spot.sum(axis=0) @ place**2)


@lru_cache(maxsize=64)
def tails(variance_px2: float) -> NDArray[np.float64]:
    """Return the spot (k, k) of unit sum whose light falls as exp(-r / a).

    Its transform is (1 + t q / 3)^(-3/2) for the variance t. With q = 4 sin^2(u / 2) +
    4 sin^2(v / 2) in place of the squared frequency u^2 + v^2, the variance is exact on the pixels.
    The discrete Gaussian is exp(-t q / 2).
    """
    radius = math.ceil(_REACH * math.sqrt(variance_px2)) + 1
    side = 1 << math.ceil(math.log2(4 * radius + 2))
    line = 4 * np.sin(np.pi * np.fft.fftfreq(side)) ** 2
    square = line[:, None] + line[None, : side // 2 + 1]
    spread = np.fft.irfft2((1 + variance_px2 / 3 * square) ** -1.5, (side, side))
    place = np.arange(-radius, radius + 1)
    spot = np.clip(spread[np.ix_(place, place)], 0, None)
    spot /= spot.sum()
    spot.setflags(write=False)
    return spot
