"""Laser speckle: the grain of coherent light on rough surfaces.

Mutually incoherent speckle patterns (polarisations, emitters, grains within a pixel) add up to
N looks. The sum is gamma-distributed with contrast C = 1 / sqrt(N). Speckle depends on the position
of surface and pupil: it is static while nothing moves, and independent in two imagers. It
multiplies laser light only. A motion of scene or camera by more than a grain needs a new draw.

Sources: Goodman, Some fundamental properties of speckle, J. Opt. Soc. Am. 66 (1976) 1145; Goodman,
Speckle Phenomena in Optics (2007), ch. 3 (sums), 4 (size, gamma law of integrated speckle).
"""

from __future__ import annotations

from functools import lru_cache
from typing import Literal

import cv2
import numba as nb
import numpy as np
from numpy.typing import NDArray
from scipy import special

from starling.patterns import errors
from starling.sim import randomness
from starling.sim.arrays import Image
from starling.sim.sensor.sensor import Imager, Projector

_FWHM_PER_SIGMA = float(2 * np.sqrt(2 * np.log(2)))
_LEAST_WEIGHT = 1e-3  # Smaller taps, relative to the filter's largest, are left out.
_REACH = 6.0  # Range of the quantile table [standard deviations].
_ENTRIES = 4096  # Entries of the quantile table.


def apply_speckle(
    laser: Image, imager: Imager, projector: Projector, side: Literal["left", "right"], *, seed: int
) -> Image:
    """Multiply the laser's light by speckle; the input array if the contrast is 0.

    Args:
        laser: (h, w) the laser's light, blurred by the lens [W m^-2 sr^-1].
        imager: its aperture sets the grain size.
        projector: supplies wavelength and speckle contrast.
        side: which imager; speckle is independent in each.
        seed: seed of the capture; its frames share the speckle.
    """
    if projector.speckle_contrast == 0:
        return laser
    grain_px = grain_size_px(
        wavelength_nm=projector.wavelength_nm,
        f_number=imager.lens.f_number,
        pixel_pitch_m=imager.pixel_pitch_m,
    )
    height, width = laser.shape
    return laser * _field((height, width), projector.speckle_contrast, grain_px, side, seed)


@lru_cache(maxsize=2)  # Both imagers: the frames of a capture share one draw.
def _field(shape: tuple[int, int], contrast: float, grain_px: float, side: str, seed: int) -> Image:
    rng = randomness.generator(seed, 0, "optics", f"speckle {side}")
    field = draw_speckle(shape, contrast=contrast, grain_px=grain_px, rng=rng)
    field.setflags(write=False)  # The cache returns the same array to all callers.
    return field


def grain_size_px(*, wavelength_nm: float, f_number: float, pixel_pitch_m: float) -> float:
    """Return the full width at half maximum of a grain, lambda N over the pixel pitch [px].

    Behind a circular pupil the intensity correlates as |2 J1(v) / v|^2, v = pi r / (lambda N),
    which is 1.03 lambda N wide (Goodman 2007, sec. 4.4). A Gaussian of width lambda N approximates
    it: pixel averages have the same contrast within 3 % for N = 0.5 to 16 (at 3 um and 850 nm).
    Lens aberrations do not change the width, because they shift phases that are already random.

    Args:
        wavelength_nm: wavelength of the laser [nm].
        f_number: aperture number N of the lens.
        pixel_pitch_m: side of a pixel [m].
    """
    return wavelength_nm * 1e-9 * f_number / pixel_pitch_m


def draw_speckle(
    shape: tuple[int, int], *, contrast: float, grain_px: float, rng: np.random.Generator
) -> Image:
    """Draw the factor that speckle applies to each pixel's laser light.

    Args:
        shape: (h, w) of the image.
        contrast: standard deviation over mean in a pixel, after averaging over it, in (0, 1].
        grain_px: see `grain_px`; neighbouring pixels share the grains on their border.
        rng: generator of this imager; the other imager needs another generator.

    Returns:
        (h, w), mean 1, gamma-distributed with shape 1 / contrast^2.

    Raises:
        InputError: if the contrast is not in (0, 1] or the grain not in (0, 50] px.
    """
    errors.in_interval("contrast", contrast, 1e-6, 1.0, "Leave speckle out where there is none.")
    errors.in_interval("grain_px", grain_px, 1e-6, 50.0, "It is about lambda N / pitch.")
    taps = taps_of_grain(grain_px)
    margin = len(taps) // 2
    noise = rng.standard_normal((shape[0] + 2 * margin, shape[1] + 2 * margin), np.float32)
    correlated = np.asarray(cv2.sepFilter2D(noise, cv2.CV_32F, taps, taps), np.float32)
    inner = correlated[margin : margin + shape[0], margin : margin + shape[1]]
    return _looked_up(inner, gamma_of_normal(contrast))


def _pixel_covariance(lag_px: NDArray[np.float64], grain_px: float) -> NDArray[np.float64]:
    """Covariance of two pixels' averages along one axis, relative to the variance at a point.

    Averaging over pixels convolves the correlation with a triangle two pixels wide.
    """
    sigma = grain_px / _FWHM_PER_SIGMA

    def second_integral(x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Second antiderivative of the Gaussian exp(-x^2 / 2 sigma^2)."""
        u = x / (np.sqrt(2) * sigma)
        return sigma * np.sqrt(np.pi / 2) * x * special.erf(u) + sigma**2 * np.exp(-(u**2))

    return second_integral(lag_px + 1) - 2 * second_integral(lag_px) + second_integral(lag_px - 1)


@lru_cache(maxsize=8)
def taps_of_grain(grain_px: float) -> NDArray[np.float32]:
    """Filter along one axis that gives white noise the correlation of neighbouring pixels."""
    reach = int(np.ceil(2 + 3 * grain_px))
    lag = np.arange(-4 * reach, 4 * reach + 1, dtype=np.float64)
    covariance = _pixel_covariance(lag, grain_px)
    power = np.fft.fft(np.fft.ifftshift(covariance)).real
    taps = np.fft.fftshift(np.fft.ifft(np.sqrt(np.maximum(power, 0))).real)
    used = np.abs(lag[np.abs(taps) > _LEAST_WEIGHT * taps.max()]).max()
    taps = taps[np.abs(lag) <= used]
    return (taps / np.sqrt((taps**2).sum())).astype(np.float32)


@lru_cache(maxsize=16)
def gamma_of_normal(contrast: float) -> NDArray[np.float32]:
    """Gamma variate of mean 1 for each of the standard normal deviates from -6 to 6."""
    normal = np.linspace(-_REACH, _REACH, _ENTRIES)
    looks = contrast**-2
    low = special.gammaincinv(looks, special.ndtr(np.minimum(normal, 0)))
    high = special.gammainccinv(looks, special.ndtr(-np.maximum(normal, 0)))
    return (np.where(normal < 0, low, high) / looks).astype(np.float32)


@nb.njit(nogil=True, cache=True)
def _looked_up(normal: Image, table: NDArray[np.float32]) -> Image:
    """Interpolate in the table of `gamma_of_normal`, pixel by pixel."""
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
