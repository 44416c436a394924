"""Temporal noise, drawn for each frame, and fixed offsets."""

from __future__ import annotations

import math
from typing import NamedTuple

import numba as nb
import numpy as np

from starling.sim import randomness
from starling.sim.arrays import Image
from starling.sim.imaging.imager import converter, noise_colour
from starling.sim.imaging.imager.charge import Die
from starling.sim.sensor.sensor import Imager

_WIDEST = 6.0  # Deviations of normal noise that matter.
_LEAST_SEEN = 0.25  # Codes hide noise below this share of their step.


def noise_e(part: Imager, electrons: Image, exposure_s: float) -> Image:
    """Return the standard deviation of a pixel around the mean signal [electrons] (h, w).

    It includes shot noise of light and dark current, read noise, dark offsets (DSNU), and row and
    column noise, after the device's averaging. It excludes the converter's step, and PRNU, which
    is proportional to the signal and never hides it.

    Args:
        part: the imager.
        electrons: photoelectrons (h, w).
        exposure_s: integration time [s].
    """
    mean = np.maximum(electrons, 0) + np.float32(part.dark_current_e_s * exposure_s)
    shot, steady = variances(part)
    return np.sqrt(np.float32(shot) * mean + np.float32(steady))


def variances(part: Imager) -> tuple[float, float]:
    """Return the variance for each electron of the mean, and that without light [electrons^2]."""
    alone = part.read_noise_e**2 + part.dsnu_e**2
    along = part.row_noise_e**2 + part.column_noise_e**2
    share = converter.variance_share(part.smoothing_px)
    mixing = (part.mosaic, part.smoothing_px)
    white = share * converter.pixel_variance_share(*mixing)
    drawn = share * converter.pixel_variance_share(*mixing, part.noise_correlation)
    steady = white * alone + (drawn - white) * part.read_noise_e**2 + along
    return part.shot_noise**2 * share * drawn, share * steady


class DarkWindow(NamedTuple):
    """What a window of an image shows without light."""

    deviation_dn: float  # Standard deviation of its codes [DN of 8 bits]; 0 if they hide the noise.
    ceiling_dn: float  # Windows with a larger mean are lit [DN of 8 bits].


def dark_window(part: Imager, bits: int) -> DarkWindow:
    """Return what a window shows without light, at the longest exposure.

    Images with fewer bits than the matcher reads may hide the noise. Dark surfaces, which the
    matcher sees, are then as flat as no surface. So are 8-bit images that most devices deliver.

    Args:
        part: the imager.
        bits: of the codes, at most 10.
    """
    exposure_s = part.auto_exposure_max_s if part.auto_exposure_level else part.exposure_s
    dark_e = noise_e(part, np.zeros((1, 1), np.float32), exposure_s)
    noise = converter.apply_gamma(dark_e * part.dn_per_electron, part.gamma, part.ceiling_dn)
    codes_per_dn = 2.0 ** (bits - part.bit_depth)
    noise_codes = codes_per_dn * noise.item()
    current_dn = part.dark_current_e_s * exposure_s * part.dn_per_electron
    level = codes_per_dn * (part.black_level_dn + current_dn)
    hidden = not noise_codes or (noise_codes < _LEAST_SEEN and bits < part.matched_bits)
    deviation = 0.0 if hidden else _rounded_deviation(level, noise_codes)
    middle = codes_per_dn * (part.black_level_dn + part.saturation_dn) / 2
    per_eight = 1 if bits == 8 else 4  # The matcher takes other images for 10 bits.
    return DarkWindow(deviation / per_eight, middle / per_eight)


def _rounded_deviation(level: float, noise: float) -> float:
    """Return the standard deviation of normal noise around a level after rounding [codes]."""
    reach = math.ceil(_WIDEST * noise) + 1
    codes = range(round(level) - reach, round(level) + reach + 1)
    below = [math.erf((code - 0.5 - level) / (math.sqrt(2) * noise)) / 2 for code in codes]
    share = np.diff([*below, 0.5])
    off = np.asarray(codes) - level
    return float(np.sqrt(share @ off**2 - (share @ off) ** 2))


def shot_and_read(part: Imager, charge: Image, *, die: Die, seed: int, frame: int) -> Image:
    """Add shot and read noise as one draw; the identity if both are 0.

    A Poisson count plus a Gaussian is approximated by a transformed normal deviate with the same
    mean and variance. The third moment nearly agrees (first term of the Cornish-Fisher expansion).
    It holds for a few electrons too, and takes a tenth of the time of a Poisson draw. Single
    electrons are not resolved; they would show only with read noise below 0.5 electrons.

    Source: EMVA Standard 1288, release 4.0 (noise model); Abramowitz and Stegun, 26.2.49.
    """
    if part.shot_noise == 0 and part.read_noise_e == 0:
        return charge
    rng = randomness.generator(seed, frame, "imager", f"noise {die.side}")
    draw = noise_colour.draw(rng, charge.shape, part.noise_correlation)
    _add_noise(charge, draw, np.float32(part.shot_noise), np.float32(part.read_noise_e))
    return draw


@nb.njit(nogil=True, cache=True, error_model="numpy")
def _add_noise(charge, draw, shot, read):
    """Turn the draw, in place, into the charge with noise."""
    unity, two, six = np.float32(1), np.float32(2), np.float32(6)  # Otherwise numba uses float64.
    variance_each, third_each = shot * shot, shot * shot * shot / six
    least = np.float32(1e-12)  # Prevents division by zero; far below any real variance.
    for y in range(charge.shape[0]):
        for x in range(charge.shape[1]):
            mean = max(charge[y, x], np.float32(0))
            variance = variance_each * mean + read * read
            deviation = np.sqrt(variance)
            bend = third_each * mean / max(variance * deviation, least)
            z = draw[y, x]
            bent = z + bend * (z * z - unity)
            draw[y, x] = charge[y, x] + deviation * bent / np.sqrt(unity + two * bend * bend)


def offsets(part: Imager, charge: Image, *, die: Die, seed: int, frame: int) -> Image:
    """Add the offsets of pixels and columns (fixed) and of rows (drawn for each frame)."""
    if part.dsnu_e == part.column_noise_e == part.row_noise_e == 0:
        return charge
    height, width = charge.shape
    rows, columns = np.zeros(height, np.float32), np.zeros(width, np.float32)
    if part.row_noise_e > 0:
        rng = randomness.generator(seed, frame, "imager", f"row {die.side}")
        rows = np.float32(part.row_noise_e) * rng.standard_normal(height, np.float32)
    if part.column_noise_e > 0:
        columns = np.float32(part.column_noise_e) * die.normal("column", (width,))
    if part.dsnu_e == 0:
        return np.asarray(charge + (rows[:, None] + columns), np.float32)
    return _offset(charge, rows, columns, np.float32(part.dsnu_e), die.normal("dsnu", charge.shape))


@nb.njit(nogil=True, cache=True)
def _offset(charge, rows, columns, dsnu_e, pattern):
    out = np.empty_like(charge)
    for y in range(charge.shape[0]):
        for x in range(charge.shape[1]):
            out[y, x] = charge[y, x] + (rows[y] + columns[x]) + dsnu_e * pattern[y, x]
    return out
