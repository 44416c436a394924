"""Laser speckle as a log-normal field with the correlation of a round aperture."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.special import j1

from starling.diagnosis.validation.camera.nominal import Nominal

_LAGS = 2  # Largest pixel distance with modelled correlation [px].
_FINE = 24  # Quadrature points per pixel.


def grain(
    shape: tuple[int, int], contrast: float, nominal: Nominal, rng: np.random.Generator
) -> NDArray[np.float64]:
    """Draw the multiplicative speckle of laser light.

    The field is log-normal, where the simulator uses a gamma law. It has mean 1 and, as the
    glossary defines contrast, standard deviation `contrast` per pixel. Pixels are correlated as
    area averages of speckle. They are independent if wavelength, aperture or pitch is unknown.

    Args:
        shape: (h, w).
        contrast: Standard deviation over mean of a pixel.
        nominal: The camera.
        rng: Scene stream of one imager.

    Returns:
        Factor (h, w), > 0.
    """
    if contrast == 0.0:
        return np.ones(shape)
    log_variance = math.log1p(contrast**2)
    normal = _correlated(shape, _correlation(nominal), log_variance, rng)
    return np.exp(math.sqrt(log_variance) * normal - 0.5 * log_variance)


def _correlation(nominal: Nominal) -> NDArray[np.float64]:
    """Return the correlation of pixels at lags 0 to `_LAGS` along both axes.

    Behind a round aperture the correlation of speckle intensity is (2 J1(u) / u)^2 with
    u = pi r / (lambda F) (Goodman, Speckle Phenomena in Optics, 2007, sec. 4.4). A pixel averages
    over its area, which weights an offset x by 1 - |x| along each axis.
    """
    out = np.zeros((_LAGS + 1, _LAGS + 1))
    out[0, 0] = 1.0
    wavelength_nm, f_number = nominal.wavelength_nm, nominal.f_number
    if wavelength_nm is None or f_number is None or nominal.pixel_pitch_m is None:
        return out
    width_px = wavelength_nm * 1e-9 * f_number / nominal.pixel_pitch_m
    offset_px = (np.arange(-(_LAGS + 1) * _FINE, (_LAGS + 1) * _FINE) + 0.5) / _FINE
    u = math.pi * np.hypot(offset_px[:, None], offset_px[None, :]) / width_px
    intensity = (2.0 * j1(u) / u) ** 2
    weight = np.clip(1.0 - np.abs(offset_px[None, :] - np.arange(_LAGS + 1)[:, None]), 0.0, None)
    shared = weight @ intensity @ weight.T
    return shared / shared[0, 0]


def _correlated(
    shape: tuple[int, int],
    correlation: NDArray[np.float64],
    log_variance: float,
    rng: np.random.Generator,
) -> NDArray[np.float64]:
    """Draw standard normals whose exponentials have the correlation (translation process)."""
    target = np.log1p(np.expm1(log_variance) * correlation) / log_variance
    height, width = shape
    autocorrelation = np.zeros(shape)
    for y in range(-_LAGS, _LAGS + 1):
        for x in range(-_LAGS, _LAGS + 1):
            autocorrelation[y % height, x % width] = target[abs(y), abs(x)]
    power = np.clip(np.fft.rfft2(autocorrelation).real, 0.0, None)
    white = np.fft.rfft2(rng.standard_normal(shape))
    normal = np.fft.irfft2(white * np.sqrt(power), s=shape)
    # Clipping the spectrum changes the variance slightly.
    variance = float(np.fft.irfft2(power, s=shape)[0, 0])
    return normal / math.sqrt(variance)
