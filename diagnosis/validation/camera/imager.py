"""The imager: from light to charge, and from charge to codes.

Fixed patterns have non-Gaussian laws, as real chips have non-Gaussian tails.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.optimize import brentq
from scipy.special import i0e, i1e

from starling.diagnosis.validation.camera import psf
from starling.diagnosis.validation.camera.catalogue import Strengths
from starling.diagnosis.validation.camera.draws import Draws
from starling.diagnosis.validation.camera.psf import Image, Mask

Codes = NDArray[np.uint8] | NDArray[np.uint16]
_RATES = (np.fft.fftfreq, np.fft.rfftfreq)  # Frequencies of a real image, down and across.
_KNOTS = 129  # Number of entries of the tone curve table.


def charge(light_e: Image, strengths: Strengths, side: str, draws: Draws) -> Image:
    """Convert the expected electrons of one exposure to the charge that is read out.

    Args:
        light_e: Expected electrons (h, w), >= 0.
        strengths: Nominal camera and effect strengths.
        side: `left` or `right` imager; each has its own noise.
        draws: Random streams of the scene and frame.

    Returns:
        Charge (h, w) [electrons], at most the full well. Read noise can make it negative.
    """
    charge_e = light_e
    share = strengths["prnu"]
    if share != 0.0:
        rng = draws.device_rng(f"{side}/prnu")
        charge_e = charge_e * sensitivity(charge_e.shape, share, rng)
    charge_e = charge_e * film(strengths, side, draws, charge_e.shape)
    charge_e = charge_e + strengths["dark_current"] * strengths["exposure"]
    charge_e = share_charge(charge_e, strengths["crosstalk"])
    correlation, mean_e = strengths["noise_colour"], charge_e
    charge_e = draw_electrons(charge_e, strengths["shot_noise"], draws.frame_rng(f"{side}/shot"))
    if correlation != 0.0:
        deviation_e = np.sqrt(np.maximum(mean_e, 1e-9))
        charge_e = mean_e + deviation_e * coloured((charge_e - mean_e) / deviation_e, correlation)
    charge_e = _read(charge_e, strengths, side, draws)
    full_well_e = strengths["saturation"]
    charge_e = bloom(charge_e, strengths["blooming"], full_well_e)
    charge_e = np.minimum(charge_e, full_well_e)
    hot_share = strengths["hot_pixels"]
    if hot_share != 0.0:
        hot = saturated_pixels(charge_e.shape, hot_share, draws.device_rng(f"{side}/hot_pixels"))
        charge_e = np.where(hot, full_well_e, charge_e)
    return charge_e


def share_charge(light_e: Image, share: float) -> Image:
    """Move a share c of each pixel's electrons to its eight neighbours.

    The kernel is the outer product of (c/4, 1 - c/2, c/4) with itself. Its second moment per axis,
    c/2, and its contrast at the finest period, 1 - c, equal those of the effect page, whose kernel
    has four neighbours.
    """
    if share == 0.0:
        return light_e
    line = np.array([0.25 * share, 1.0 - 0.5 * share, 0.25 * share])
    down = ndimage.convolve1d(light_e, line, 0, mode="nearest")
    return ndimage.convolve1d(down, line, 1, mode="nearest")


def draw_electrons(light_e: Image, noise: float, rng: np.random.Generator) -> Image:
    """Draw electron numbers with a standard deviation of `noise` times that of a Poisson law.

    A noise s below 1 models a device that averages 1 / s^2 readings: the number is s^2 times a
    Poisson number of mean light / s^2.
    """
    if noise == 0.0:
        return light_e
    return noise**2 * rng.poisson(light_e / noise**2).astype(np.float64)


def bloom(charge_e: Image, share: float, full_well_e: float) -> Image:
    """Move a share of the charge above the full well along the column, half up and half down.

    Both halves spread at the same time. The result is the mean of both orders, which differ only
    where the two streams meet in one pixel.
    """
    over = np.clip(charge_e - full_well_e, 0.0, None) * (0.5 * share)
    if not over.any():
        return charge_e
    clipped = np.minimum(charge_e, full_well_e)
    down_first = _run_up(_run_down(clipped, over, full_well_e), over, full_well_e)
    up_first = _run_down(_run_up(clipped, over, full_well_e), over, full_well_e)
    return 0.5 * (down_first + up_first)


def _run_down(charge_e: Image, over: Image, full_well_e: float) -> Image:
    charge_e = charge_e.copy()
    carried = np.zeros(charge_e.shape[1])
    for row in range(len(charge_e)):
        absorbed = np.minimum(carried, full_well_e - charge_e[row])
        charge_e[row] += absorbed
        carried = carried - absorbed + over[row]
    return charge_e


def _run_up(charge_e: Image, over: Image, full_well_e: float) -> Image:
    return _run_down(charge_e[::-1], over[::-1], full_well_e)[::-1]


def sensitivity(shape: tuple[int, int], share: float, rng: np.random.Generator) -> Image:
    """Draw the gain of each pixel (h, w): gamma variates of mean 1 and std `share`."""
    return rng.gamma(share**-2, share**2, shape)


def film(strengths: Strengths, side: str, draws: Draws, shape: tuple[int, int]) -> Image:
    """Draw the smooth gain of a device's imager (h, w): log-normal, of mean 1.

    Its logarithm has the correlation exp(-(d / L)^2), by a Gaussian in the frequencies. The image
    is cut from a larger one, as frequencies join its borders.
    """
    contrast = strengths["fixed_pattern"]
    if contrast == 0.0:
        return np.ones((1, 1))
    length_px = strengths.nominal.pattern_px
    border = math.ceil(2.0 * length_px)
    height, width = shape[0] + border, shape[1] + border
    down, across = np.fft.fftfreq(height), np.fft.rfftfreq(width)
    square = down[:, None] ** 2 + across[None, :] ** 2
    white = draws.device_rng(f"{side}/fixed_pattern").standard_normal((height, width))
    filtered = np.fft.rfft2(white) * np.exp(-0.5 * (math.pi * length_px) ** 2 * square)
    field = np.fft.irfft2(filtered, s=(height, width))[: shape[0], : shape[1]]
    field *= length_px * math.sqrt(math.pi)  # The filter leaves 1 / (pi L^2) of the variance.
    variance = math.log1p(contrast**2)
    return np.exp(math.sqrt(variance) * field - 0.5 * variance)


def coloured(white: Image, correlation: float) -> Image:
    """Correlate the deviates of adjacent pixels (h, w) and keep their variance.

    The spectrum is that of the correlation I_m(2t) I_n(2t) / I_0(2t)^2 of the effect page. Opposite
    borders correlate, as frequencies join them.
    """
    if correlation == 0.0:
        return white
    t = brentq(lambda t: i1e(2.0 * t) / i0e(2.0 * t) - correlation, 0.0, 100.0)
    assert isinstance(t, float)
    down, across = (2.0 * math.pi * rate(n) for rate, n in zip(_RATES, white.shape, strict=True))
    wave = 2.0 - np.cos(down)[:, None] - np.cos(across)[None, :]
    filtered = np.fft.irfft2(np.fft.rfft2(white) * np.exp(-t * wave), s=white.shape)
    return filtered / i0e(2.0 * t)


def offsets(shape: tuple[int, int], deviation_e: float, rng: np.random.Generator) -> Image:
    """Draw the offset of each pixel (h, w) [electrons]: logistic variates with heavy tails."""
    return rng.logistic(0.0, deviation_e * math.sqrt(3.0) / math.pi, shape)


def columns(shape: tuple[int, int], deviation_e: float, rng: np.random.Generator) -> Image:
    """Draw the offset of each column (1, w) [electrons]: uniform, as of trimmed amplifiers."""
    reach = deviation_e * math.sqrt(3.0)
    return rng.uniform(-reach, reach, (1, shape[1]))


def saturated_pixels(shape: tuple[int, int], share: float, rng: np.random.Generator) -> Mask:
    """Draw a mask (h, w) of saturated pixels: a Poisson number of positions with replacement."""
    pixels = rng.integers(0, shape[0] * shape[1], rng.poisson(share * shape[0] * shape[1]))
    hot = np.zeros(shape[0] * shape[1], bool)
    hot[pixels] = True
    return hot.reshape(shape)


def add_offsets(charge_e: Image, strengths: Strengths, side: str, draws: Draws) -> Image:
    """Add pixel and column offsets to a charge (h, w) [electrons]."""
    for name, draw in (("dsnu", offsets), ("column_noise", columns)):
        deviation_e = strengths[name]
        if deviation_e != 0.0:
            rng = draws.device_rng(f"{side}/{name}")
            charge_e = charge_e + draw(charge_e.shape, deviation_e, rng)
    return charge_e


def _read(charge_e: Image, strengths: Strengths, side: str, draws: Draws) -> Image:
    """Add pixel and column offsets, row noise and read noise."""
    charge_e = add_offsets(charge_e, strengths, side, draws)
    row_e = strengths["row_noise"]
    if row_e != 0.0:
        # The sum of two uniform deviates is bounded, as the ripple of a supply voltage is.
        reach = row_e * math.sqrt(1.5)
        rows = draws.frame_rng(f"{side}/row_noise").uniform(-reach, reach, (2, len(charge_e), 1))
        charge_e = charge_e + rows.sum(0)
    read_e = strengths["read_noise"]
    if read_e != 0.0:
        white = draws.frame_rng(f"{side}/read").standard_normal(charge_e.shape)
        charge_e = charge_e + read_e * coloured(white, strengths["noise_colour"])
    return charge_e


def codes(charge_e: Image, strengths: Strengths) -> Image:
    """Convert charge to digital numbers before rounding.

    Args:
        charge_e: Charge (h, w) [electrons].
        strengths: Nominal camera and effect strengths.

    Returns:
        Digital numbers (h, w), clipped to the code range.
    """
    ceiling = top(strengths)
    signal = charge_e * dn_per_e(strengths)
    if strengths.is_active("gamma"):
        signal = tone(signal, strengths["gamma"], ceiling)
    dn = np.clip(signal + strengths["black_level"], 0.0, ceiling)
    return smooth(dn, strengths["smoothing"])


def top(strengths: Strengths) -> float:
    """Return the largest code [DN]."""
    return 2.0 ** strengths["quantisation"] - 1.0


def dn_per_e(strengths: Strengths) -> float:
    """Return the conversion factor [DN/electron]: largest code over full well, times the gain."""
    nominal = strengths.nominal
    scale = nominal.dn_per_e * strengths["gain"]
    scale *= nominal.full_well_e / strengths["saturation"]
    return scale * top(strengths) / (2.0**nominal.bit_depth - 1.0)


def tone(signal_dn: Image, gamma: float, ceiling: float) -> Image:
    """Apply a gamma curve by linear interpolation in a table, as devices do.

    Knots are denser where the curve is steep. Values below 0 become 0.
    """
    signal = np.linspace(0.0, 1.0, _KNOTS) ** max(gamma, 1.0)
    return ceiling * np.interp(signal_dn / ceiling, signal, signal ** (1.0 / gamma))


def smooth(dn: Image, sigma_px: float) -> Image:
    """Average neighbouring codes with a Gaussian kernel, as the device's resampling does."""
    if sigma_px == 0.0:
        return dn
    return psf.blur(np.rint(dn), psf.kernel("gaussian", sigma_px))


def round_codes(dn: Image, bits: int) -> Codes:
    """Round to codes of `bits` bits, stored as uint8 for at most 8 bits, else as uint16."""
    rounded = np.clip(np.rint(dn), 0, 2**bits - 1)
    return rounded.astype(np.uint8) if bits <= 8 else rounded.astype(np.uint16)
