"""Laser speckle: grain of coherent light, as a log-normal field of the right correlation."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.special import j1

from starling.diagnosis.validation.camera.nominal import Nominal

_LAGS = 2  # Pixels over which grains are followed.
_FINE = 24  # Points per pixel of the quadrature.


def grain(
    shape: tuple[int, int], contrast: float, nominal: Nominal, rng: np.random.Generator
) -> NDArray[np.float64]:
    """Draw the factor that grain puts on laser light.

    Log-normal in place of gamma. Mean 1 and standard deviation `contrast` *in the pixel*, which is
    how the glossary defines it; pixels are correlated as averages of speckle over their area are.
    Where the camera's wavelength, aperture or pitch is unknown they are independent.

    Args:
        shape: (h, w).
        contrast: Standard deviation over mean in a pixel.
        nominal: The camera.
        rng: The scene's, another for each imager.

    Returns:
        Factor (h, w), > 0.
    """
    if contrast == 0.0:
        return np.ones(shape)
    log_variance = math.log1p(contrast**2)
    normal = _correlated(shape, _correlation(nominal), log_variance, rng)
    return np.exp(math.sqrt(log_variance) * normal - 0.5 * log_variance)


def _correlation(nominal: Nominal) -> NDArray[np.float64]:
    """Correlation of neighbouring pixels at lags 0 to `_LAGS` along both axes.

    The intensity of speckle behind a round aperture is correlated as (2 J1(u) / u)^2,
    u = pi r / (lambda F) (Goodman, Speckle Phenomena in Optics, 2007, sec. 4.4); a pixel averages
    it over its area, which weights a difference x of places by 1 - |x| along each axis.
    """
    out = np.zeros((_LAGS + 1, _LAGS + 1))
    out[0, 0] = 1.0
    wavelength_nm, f_number = nominal.wavelength_nm, nominal.f_number
    if wavelength_nm is None or f_number is None or nominal.pixel_pitch_m is None:
        return out
    width_px = wavelength_nm * 1e-9 * f_number / nominal.pixel_pitch_m
    place = (np.arange(-(_LAGS + 1) * _FINE, (_LAGS + 1) * _FINE) + 0.5) / _FINE
    u = math.pi * np.hypot(place[:, None], place[None, :]) / width_px
    intensity = (2.0 * j1(u) / u) ** 2
    weight = np.clip(1.0 - np.abs(place[None, :] - np.arange(_LAGS + 1)[:, None]), 0.0, None)
    shared = weight @ intensity @ weight.T
    return shared / shared[0, 0]


def _correlated(
    shape: tuple[int, int],
    correlation: NDArray[np.float64],
    log_variance: float,
    rng: np.random.Generator,
) -> NDArray[np.float64]:
    """Draw standard normals whose exponentials have the correlation (translation of the field)."""
    wanted = np.log1p(np.expm1(log_variance) * correlation) / log_variance
    height, width = shape
    around = np.zeros(shape)
    for y in range(-_LAGS, _LAGS + 1):
        for x in range(-_LAGS, _LAGS + 1):
            around[y % height, x % width] = wanted[abs(y), abs(x)]
    power = np.clip(np.fft.rfft2(around).real, 0.0, None)
    white = np.fft.rfft2(rng.standard_normal(shape))
    normal = np.fft.irfft2(white * np.sqrt(power), s=shape)
    # What was clipped off the spectrum changed the variance a little.
    kept = float(np.fft.irfft2(power, s=shape)[0, 0])
    return normal / math.sqrt(kept)
