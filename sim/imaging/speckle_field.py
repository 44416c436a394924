"""Laser speckle: the grain that coherent light has on rough surfaces.

Many mutually incoherent speckle patterns (polarisations, emitters, grains within a pixel) add up
to N looks, and the sum is gamma-distributed with contrast C = 1 / sqrt(N). It belongs to place of
surface and pupil: static while nothing moves, independent in two imagers, multiplied to laser
light alone. Whoever moves scene or camera by more than a grain has to draw it anew.

Sources: Goodman, Some fundamental properties of speckle, J. Opt. Soc. Am. 66 (1976) 1145; Goodman,
Speckle Phenomena in Optics (2007), ch. 3 (sums), 4 (size, gamma law of integrated speckle).
"""

from __future__ import annotations

from functools import lru_cache

import cv2
import numba as nb
import numpy as np
from numpy.typing import NDArray
from scipy import special

from starling.patterns import errors
from starling.sim.render.layers import Image

_FWHM_PER_SIGMA = float(2 * np.sqrt(2 * np.log(2)))
_LEAST_WEIGHT = 1e-3  # Taps below this share of the filter's largest are left out.
_REACH = 6.0  # Standard deviations that the quantile table spans.
_ENTRIES = 4096


def grain_px(*, wavelength_nm: float, f_number: float, pixel_pitch_m: float) -> float:
    """Full width at half maximum of a grain, lambda N over the pixel's pitch [px].

    The intensity correlates as |2 J1(v) / v|^2 with v = pi r / (lambda N) behind a circular pupil,
    1.03 lambda N wide (Goodman 2007, sec. 4.4). A Gaussian of lambda N stands for it: pixels
    average it to the same contrast within 3 % from N = 0.5 to 16 (at 3 um and 850 nm).
    The lens's aberrations do not change it: they turn phases that are random already.

    Args:
        wavelength_nm: of the laser.
        f_number: aperture number N of the lens.
        pixel_pitch_m: side of a pixel.
    """
    return wavelength_nm * 1e-9 * f_number / pixel_pitch_m


def looks_in_pixel(grain_px: float) -> float:
    """Independent looks that a pixel's area averages, Goodman's M.

    Source: Goodman 2007, sec. 4.6, for a square pixel and a Gaussian correlation.
    """
    return 1 / float(_pixel_covariance(np.zeros(1), grain_px)[0]) ** 2


def field(
    shape: tuple[int, int], *, contrast: float, grain_px: float, rng: np.random.Generator
) -> Image:
    """Draw the factor by which speckle changes what each pixel receives of the laser's light.

    Args:
        shape: (h, w) of the image.
        contrast: standard deviation over mean in a pixel, its own averaging included, in (0, 1].
        grain_px: see `grain_px`; neighbouring pixels share the grains on their border.
        rng: of this imager; the other one needs another.

    Returns:
        (h, w), mean 1, gamma-distributed of shape 1 / contrast^2.

    Raises:
        InputError: if the contrast is not in (0, 1] or the grain not in (0, 50] px.
    """
    errors.in_interval("contrast", contrast, 1e-6, 1.0, "Leave speckle out where there is none.")
    errors.in_interval("grain_px", grain_px, 1e-6, 50.0, "It is about lambda N / pitch.")
    taps = _taps(grain_px)
    margin = len(taps) // 2
    noise = rng.standard_normal((shape[0] + 2 * margin, shape[1] + 2 * margin), np.float32)
    correlated = np.asarray(cv2.sepFilter2D(noise, cv2.CV_32F, taps, taps), np.float32)
    inner = correlated[margin : margin + shape[0], margin : margin + shape[1]]
    return _looked_up(inner, _gamma_of_normal(contrast))


def _pixel_covariance(lag_px: NDArray[np.float64], grain_px: float) -> NDArray[np.float64]:
    """Covariance of two pixels' shares of the grain along one axis, over that of two points.

    Averaging over pixels convolves the correlation with a triangle of two pixels' width.
    """
    sigma = grain_px / _FWHM_PER_SIGMA

    def second_integral(x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Of the Gaussian exp(-x^2 / 2 sigma^2), twice from 0."""
        u = x / (np.sqrt(2) * sigma)
        return sigma * np.sqrt(np.pi / 2) * x * special.erf(u) + sigma**2 * np.exp(-(u**2))

    return second_integral(lag_px + 1) - 2 * second_integral(lag_px) + second_integral(lag_px - 1)


@lru_cache(maxsize=8)
def _taps(grain_px: float) -> NDArray[np.float32]:
    """Filter along one axis that makes white noise correlate as neighbouring pixels do."""
    reach = int(np.ceil(2 + 3 * grain_px))
    lag = np.arange(-4 * reach, 4 * reach + 1, dtype=np.float64)
    covariance = _pixel_covariance(lag, grain_px)
    power = np.fft.fft(np.fft.ifftshift(covariance)).real
    taps = np.fft.fftshift(np.fft.ifft(np.sqrt(np.maximum(power, 0))).real)
    used = np.abs(lag[np.abs(taps) > _LEAST_WEIGHT * taps.max()]).max()
    taps = taps[np.abs(lag) <= used]
    return (taps / np.sqrt((taps**2).sum())).astype(np.float32)


@lru_cache(maxsize=16)
def _gamma_of_normal(contrast: float) -> NDArray[np.float32]:
    """Gamma variate of mean 1 for each of the standard normal deviates from -6 to 6."""
    normal = np.linspace(-_REACH, _REACH, _ENTRIES)
    looks = contrast**-2
    low = special.gammaincinv(looks, special.ndtr(np.minimum(normal, 0)))
    high = special.gammainccinv(looks, special.ndtr(-np.maximum(normal, 0)))
    return (np.where(normal < 0, low, high) / looks).astype(np.float32)


@nb.njit(nogil=True, cache=True)
def _looked_up(normal: Image, table: NDArray[np.float32]) -> Image:
    """Interpolate in the table of `_gamma_of_normal`, pixel by pixel."""
    out = np.empty(normal.shape, np.float32)
    last = len(table) - 1
    scale = np.float32(last / (2 * _REACH))
    middle = np.float32(last / 2)
    for row in range(normal.shape[0]):
        for column in range(normal.shape[1]):
            place = normal[row, column] * scale + middle
            place = min(max(place, np.float32(0)), np.float32(last - 1))
            index = int(place)
            share = place - np.float32(index)
            out[row, column] = table[index] + share * (table[index + 1] - table[index])
    return out
