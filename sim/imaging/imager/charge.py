"""Charge of the pixels: fixed patterns, crosstalk, dark current, hot pixels and the full well."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import cv2
import numba as nb
import numpy as np

from starling.sim import randomness
from starling.sim.arrays import Image
from starling.sim.sensor.sensor import Imager

Side = Literal["left", "right"]


@dataclass(frozen=True, slots=True)
class Die:
    """One imager of one device; it identifies the fixed patterns."""

    unit: int  # Number of the device, `Sensor.unit`.
    side: Side

    def normal(self, effect: str, shape: tuple[int, ...]) -> Image:
        """Return standard normal deviates of pixels or grid points (h, w), or of columns (w,).

        Another image size has an independent pattern: it models a readout mode, not a crop.
        """
        return _drawn(self, effect, shape, "normal")

    def uniform(self, effect: str, shape: tuple[int, ...]) -> Image:
        """Return uniform deviates in [0, 1) of the pixels (h, w)."""
        return _drawn(self, effect, shape, "uniform")


@lru_cache(maxsize=18)  # Four patterns of two image sizes and the waves, two imagers.
def _drawn(die: Die, effect: str, shape: tuple[int, ...], law: Literal["normal", "uniform"]):
    rng = randomness.generator(die.unit, 0, "imager", f"fixed {effect} {die.side}")
    draw = rng.standard_normal if law == "normal" else rng.random
    pattern = draw(shape, np.float32)
    pattern.setflags(write=False)  # All captures share the array.
    return pattern


def collect(part: Imager, electrons: Image, exposure_s: float, die: Die) -> Image:
    """Return the mean charge of each pixel at the end of the exposure [electrons] (h, w).

    Args:
        part: the imager.
        electrons: photoelectrons in each pixel's area (h, w).
        exposure_s: integration time [s].
        die: supplies the pixels' sensitivities.
    """
    charge = crosstalk(electrons, part.crosstalk)
    if part.pattern_contrast > 0:
        charge = charge * smooth_sensitivity(part, die, charge.shape)
    dark = np.float32(part.dark_current_e_s * exposure_s)
    if part.prnu > 0:
        return _sensed(charge, np.float32(part.prnu), die.normal("prnu", charge.shape), dark)
    return charge + dark if dark > 0 else charge


def sensitivity(part: Imager, die: Die, shape: tuple[int, int]) -> Image:
    """Return the pixels' sensitivities (h, w), of mean 1: PRNU times the smooth part."""
    smooth = smooth_sensitivity(part, die, shape)
    if part.prnu == 0:
        return smooth
    pixel = np.float32(1) + np.float32(part.prnu) * die.normal("prnu", shape)
    return smooth * np.maximum(pixel, np.float32(0))


def smooth_sensitivity(part: Imager, die: Die, shape: tuple[int, ...]) -> Image:
    """Return the smooth part of the pixels' sensitivities (h, w), of mean 1.

    It is max(1 + contrast g, 0). The field g is normal, of variance 1, and of correlation
    exp(-(d / L)^2) at the distance d. Each imager of each device has its own.

    Source: EMVA Standard 1288, release 4.0, which separates the slow part of the photo response
    from PRNU by a high-pass. Films, dust and interference in glass and silicon cause it.
    """
    field = _smooth_field(die, (shape[0], shape[1]), part.pattern_px)
    return np.maximum(np.float32(1) + np.float32(part.pattern_contrast) * field, np.float32(0))


@lru_cache(maxsize=4)  # Both imagers, two image sizes.
def _smooth_field(die: Die, shape: tuple[int, int], length_px: float) -> Image:
    """White noise through a Gaussian whose sigma is half the length, and of unit variance."""
    sigma = length_px / 2
    reach = int(np.ceil(4 * sigma))
    weights = cv2.getGaussianKernel(2 * reach + 1, sigma, cv2.CV_32F)
    weights /= np.sqrt((weights**2).sum())
    height, width = shape
    white = die.normal("pattern", (height + 2 * reach, width + 2 * reach))
    smooth = cv2.sepFilter2D(white, cv2.CV_32F, weights, weights)
    field = np.ascontiguousarray(smooth[reach : reach + height, reach : reach + width], np.float32)
    field.setflags(write=False)  # All captures share the array.
    return field


@nb.njit(nogil=True, cache=True)
def _sensed(charge, prnu, pattern, dark):
    out = np.empty_like(charge)
    unity, zero = np.float32(1), np.float32(0)
    for y in range(charge.shape[0]):
        for x in range(charge.shape[1]):
            out[y, x] = charge[y, x] * max(unity + prnu * pattern[y, x], zero) + dark
    return out


def crosstalk(electrons: Image, share: float) -> Image:
    """Move a share of each pixel's electrons to its four neighbours; 0 is the identity.

    The image's total is preserved: electrons that would leave the image stay in the border pixel.
    The diffusion precedes charge collection, so the shot noise of neighbours stays independent.

    Source: Djite et al., IEEE Trans. Electron Devices 59 (2012) 729. Charge diffuses further if
    light is absorbed deeper, so most in the near infrared.
    """
    if share == 0:
        return electrons
    neighbour = share / 4
    kernel = np.array(
        [[0, neighbour, 0], [neighbour, 1 - share, neighbour], [0, neighbour, 0]], np.float32
    )
    mixed = cv2.filter2D(electrons, cv2.CV_32F, kernel, borderType=cv2.BORDER_REPLICATE)
    return np.asarray(mixed, np.float32)


def fill_hot_pixels(part: Imager, charge: Image, die: Die) -> Image:
    """Fill the device's hot pixels; a share of 0 is the identity.

    The hot pixels of a smaller share are a subset of those of a larger share.
    """
    if part.hot_pixels == 0:
        return charge
    full = np.flatnonzero(die.uniform("hot", charge.shape) < np.float32(part.hot_pixels))
    filled = charge.copy()
    flat = filled.ravel()
    flat[full] = np.maximum(flat[full], np.float32(part.full_well_e))
    return filled


def limit_to_full_well(part: Imager, charge: Image) -> Image:
    """Limit the charge to the full well; with blooming, part of the excess fills its column.

    The share 1 - `blooming` of the excess charge is drained in its pixel. Half of the remaining
    charge moves upwards, half downwards. It fills the free capacity of the pixels on its way, until
    it is used up or leaves the image. Where two streaks meet, the downward one fills first.

    Source: Janesick, Scientific Charge-Coupled Devices (2001). Charge above the full well runs
    along its column; the drained share models an anti-blooming gate.
    """
    full = np.float32(part.full_well_e)
    if part.blooming == 0 or charge.max() <= full:
        return np.minimum(charge, full)
    return _spilled(charge, full, np.float32(part.blooming / 2))


@nb.njit(nogil=True, cache=True)
def _spilled(charge, full, half):
    height, width = charge.shape
    out = charge.copy()
    down, up = np.zeros(width, charge.dtype), np.zeros(width, charge.dtype)
    for y in range(height):
        for x in range(width):
            held = out[y, x]
            if held > full:
                down[x] += half * (held - full)
            elif down[x] > 0:
                taken = min(down[x], full - held)
                out[y, x] = held + taken
                down[x] -= taken
    for row in range(height):
        y = height - 1 - row
        for x in range(width):
            held = out[y, x]
            if charge[y, x] > full:
                up[x] += half * (charge[y, x] - full)
            elif up[x] > 0:
                taken = min(up[x], max(full - held, np.float32(0)))
                held += taken
                up[x] -= taken
            out[y, x] = min(held, full)
    return out
