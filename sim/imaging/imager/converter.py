"""The converter: charge to digital numbers (DN), with a device's interpolation and averaging."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any, cast

import cv2
import numba as nb
import numpy as np
from numpy.typing import NDArray

from starling.sim.arrays import Image
from starling.sim.imaging.imager import mosaic, noise_colour
from starling.sim.sensor.imager import Mosaic
from starling.sim.sensor.sensor import Imager

Infrared = NDArray[np.uint8] | NDArray[np.uint16]


def smooth(signal: Image, sigma_px: float) -> Image:
    """Average neighbouring pixels with a Gaussian, as resampling does; 0 px is the identity.

    The variance of independent noise falls to 1 / (4 pi sigma^2) of its value (within 3 % for
    sigma >= 0.7 px, within 0.1 % for sigma >= 1 px). At distance d its correlation becomes
    exp(-d^2 / (4 sigma^2)).
    """
    if sigma_px == 0:
        return signal
    kernel = smoothing_weights(sigma_px)
    averaged = cv2.sepFilter2D(signal, cv2.CV_32F, kernel, kernel, borderType=cv2.BORDER_REFLECT)
    return np.asarray(averaged, np.float32)


def mix(part: Imager, signal: Image) -> Image:
    """Mix neighbouring pixels as the device does: luminance of the mosaic, and averaging."""
    return smooth(mosaic.luminance(signal, part.mosaic), part.smoothing_px)


@cache
def pixel_variance_share(kind: Mosaic, sigma_px: float, correlation: float = 0.0) -> float:
    """Return the variance of pixels' noise after mixing, over that of white noise after averaging.

    It is the mean over the pixels. Luminance of a mosaic reduces noise and correlates it, so that
    averaging reduces it less. So does the correlation that the noise has before.

    Args:
        kind: colour filters.
        sigma_px: of the averaging [px].
        correlation: of the noise of adjacent pixels.
    """
    if kind == "none" and correlation == 0:
        return 1.0
    line = noise_colour.weights(correlation)
    reach = len(line) // 2
    half = int(np.ceil(4 * sigma_px) + 4) + reach
    total = 0.0
    for down, right in np.ndindex(2, 2):
        point = np.zeros((2 * half, 2 * half), np.float32)
        rows, columns = (
            slice(half + place - reach, half + place + reach + 1) for place in (down, right)
        )
        point[rows, columns] = np.outer(line, line)
        mixed = smooth(mosaic.luminance(point, kind), sigma_px).astype(np.float64)
        total += float((mixed**2).sum())
    return total / 4 / variance_share(sigma_px) ** 2


def variance_share(sigma_px: float) -> float:
    """Return the share of independent noise's variance left after averaging along one axis."""
    return (
        1.0 if sigma_px == 0 else float((smoothing_weights(sigma_px).astype(np.float64) ** 2).sum())
    )


def smoothing_weights(sigma_px: float) -> Any:
    """Return the Gaussian's weights along one axis (2 ceil(4 sigma) + 1, 1), for sigma > 0."""
    reach = max(int(np.ceil(4 * sigma_px)), 1)
    return np.asarray(cv2.getGaussianKernel(2 * reach + 1, sigma_px, cv2.CV_32F))


@dataclass(frozen=True, slots=True, eq=False)
class Readout:
    """Digital images of one exposure, each (h, w), uint8 for 8 bits, otherwise uint16."""

    delivered: Infrared  # Output image, with `bit_depth` bits.
    matched: Infrared  # Input of the matcher, with `matched_bits` bits.


def convert(part: Imager, charge: Image) -> Readout:
    """Convert charge [electrons] to DN: gain, mixing, gamma, black level, quantisation."""
    signal = charge * np.float32(part.dn_per_electron)
    if part.smoothing_px > 0 or part.mosaic != "none":
        # The device mixes codes, so the signal is clipped before mixing, not after it.
        np.clip(signal, *clipping_range(part), out=signal)
        signal = mix(part, signal)
    signal = apply_gamma(signal, part.gamma, part.ceiling_dn)
    signal += np.float32(part.black_level_dn)
    delivered = quantise(part, signal)
    finer = part.matched_bits > part.bit_depth
    return Readout(delivered, quantise_matched(part, signal) if finer else delivered)


def apply_gamma(signal: Image, gamma: float, ceiling_dn: float) -> Image:
    """Return ceiling (signal / ceiling)^(1 / gamma), odd about 0; gamma 1 is the identity.

    The black level is not part of the signal, so a dark pixel has the same DN at every gamma.
    """
    if gamma == 1:
        return signal
    share = np.abs(signal)
    share *= np.float32(1 / ceiling_dn)
    cv2.pow(share, 1 / gamma, dst=share)
    share *= np.float32(ceiling_dn)
    return np.copysign(share, signal, out=share)


def clipping_range(part: Imager) -> tuple[np.float32, np.float32]:
    """Return the signals that map to code 0 and to the ceiling."""
    ends = np.array([[0, part.ceiling_dn]], np.float32) - np.float32(part.black_level_dn)
    low, high = apply_gamma(ends, 1 / part.gamma, part.ceiling_dn)[0]
    return low, high


def quantise(imager: Imager, level: Image) -> Infrared:
    """Quantise a level [DN] to `bit_depth` bits (h, w): uint8 for 8 bits, otherwise uint16."""
    return _codes(level, imager.bit_depth)


def quantise_matched(imager: Imager, level: Image) -> Infrared:
    """Quantise a level [DN] to `matched_bits` bits (h, w), with several codes per DN."""
    scale = np.float32(2 ** (imager.matched_bits - imager.bit_depth))
    return _codes(level * scale, imager.matched_bits)


def _codes(level: Image, bits: int) -> Infrared:
    codes = np.empty(level.shape, np.uint8 if bits == 8 else np.uint16)
    _round(level, np.float32(2**bits - 1), codes)
    return cast(Infrared, codes)


@nb.njit(nogil=True, cache=True)
def _round(level, ceiling, codes):
    for y in range(level.shape[0]):
        for x in range(level.shape[1]):
            codes[y, x] = np.int32(min(max(np.rint(level[y, x]), np.float32(0)), ceiling))
