"""Estimation of a captured room's reflectance and ambient light.

Brightness alone does not separate light from reflectance. But the projector's light on the known
surfaces can be computed. The contrast of its dots in the image gives the ambient light. With both
lights known, the image's brightness gives the reflectance up to a factor.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np

from starling.sim.arrays import Image, Mask
from starling.sim.imaging.imager import read_out
from starling.sim.imaging.signals import Signals
from starling.sim.sensor.sensor import Imager

# Default without dots [W m^-2]. It gives a D415's dots the contrast of lit rooms, 0.1 to 0.35.
LIT_ROOM_W_M2 = 0.4
_DIMMEST, _BRIGHTEST = 0.01, 100.0  # Search range of ambient light [W m^-2].
_HALVINGS = 8  # Bisections of the logarithm of this range; they give 4 %.
_EVEN_PX = 12.0  # Sigma at which the model's brightness is matched to the image's [px].
_AROUND_PX = 16.0  # Sigma of the neighbourhood of dot contrast, a few dots wide [px].
_MEAN_REFLECTANCE = 0.5  # Assumed, because an image gives reflectance only up to a factor.
_DARKEST = 0.02  # Least divisor, relative to the median.

_DOT_SIGMA_PX = 1.55  # FWHM of 3.4 to 3.9 px, as measured on the D415 [px].
_ROUNDNESS = 0.45  # Least ratio of a dot's two curvatures; stripes and letters have smaller ones.
_ROUNDS = 4  # Passes over the residual, since dots overlap.


@dataclass(frozen=True, slots=True, eq=False)
class RoomLight:
    """Reflectance and ambient light of a room."""

    reflectance: Image  # (h, w)
    ambient_w_m2: float
    ambient_share: Image | None = None  # (h, w), local light over `ambient_w_m2`; None: 1.


def ambient_w_m2(dotted: Image, light: Signals, imager: Imager) -> float:
    """Estimate the irradiance of even ambient light from the contrast of the dots.

    Bisection finds the ambient light at which image and model have the same median dot contrast.
    The model image shows even surfaces with the image's local brightness and noise. The positions
    of the dots do not matter.

    Args:
        dotted: (h, w) image with dots [DN above black].
        light: Signals of the image's imager on surfaces of one reflectance.
        imager: Imager, for its noise.

    Returns:
        Irradiance from 0.01 to 100 W m^-2; `LIT_ROOM_W_M2` if the projector is off.
    """
    if not light.laser.any():
        return LIT_ROOM_W_M2
    contrast, level = _dot_share(dotted), _smooth(dotted)
    low, high = np.log(_DIMMEST), np.log(_BRIGHTEST)
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        lit = _sum(light, float(np.exp(middle)))
        model = _read_out(lit * _ratio(level, _smooth(lit)), imager)
        if np.median(_dot_share(model) - contrast) > 0:
            low = middle
        else:
            high = middle
    return float(np.exp(0.5 * (low + high)))


def reflectance(
    level: Image, light: Signals, ambient: float, detail: Callable[[Image], Image]
) -> Image:
    """Estimate the reflectance (h, w), scaled to a mean of 0.5, from an image's brightness.

    Args:
        level: (h, w) image [DN above black], including dots.
        light: Light of the image, on surfaces of one reflectance.
        ambient: Irradiance of ambient light [W m^-2].
        detail: Filter that removes dots from an image.
    """
    return plausible_reflectance(_ratio(detail(level), detail(_sum(light, ambient))))


def plausible_reflectance(brightness: Image) -> Image:
    """Scale brightness (h, w) to a mean of 0.5 and clip it to 0.01 to 0.95."""
    scale = _MEAN_REFLECTANCE / max(float(brightness.mean()), 1e-6)
    return np.clip(brightness * np.float32(scale), 0.01, 0.95).astype(np.float32)


def _dot_share(image: Image) -> Image:
    """Share of round spots in the light around each pixel."""
    image = np.asarray(np.maximum(image, 0), np.float32)
    spots = np.asarray(np.maximum(image - remove_dots(image), 0), np.float32)
    return _ratio(_blurred(spots, _AROUND_PX), _blurred(image, _AROUND_PX))


def _read_out(level_dn: Image, imager: Imager) -> Image:
    """Add one realisation of the imager's noise and round to whole codes [DN above black]."""
    electrons = level_dn / np.float32(imager.dn_per_electron)
    read = read_out(
        imager, electrons, exposure_s=imager.exposure_s, unit=0, side="left", seed=0, frame=0
    )
    return read.delivered.astype(np.float32) - np.float32(imager.black_level_dn)


def _smooth(image: Image) -> Image:
    return _blurred(np.asarray(np.maximum(image, 0), np.float32), _EVEN_PX)


def _blurred(image: Image, sigma_px: float) -> Image:
    return np.asarray(cv2.GaussianBlur(image, (0, 0), sigma_px), np.float32)


def _sum(light: Signals, ambient: float) -> Image:
    lit = light.laser + light.other + ambient * light.ambient
    return np.asarray(lit, np.float32)


def _ratio(image: Image, divisor: Image) -> Image:
    """Divide images; the divisor is at least a share of its median."""
    least = max(_DARKEST * float(np.median(divisor)), 1e-30)
    return np.asarray(image / np.maximum(divisor, least), np.float32)


def remove_dots(level: Image) -> Image:
    """Subtract round Gaussian spots, detected by curvature and fitted over a local plane.

    Args:
        level: (h, w) linear image with dots.

    Returns:
        (h, w) image without dots; weak and even projector light remains.
    """
    spot, fit = _spot_and_fit()
    rest = level
    for _ in range(_ROUNDS):
        amplitude = np.where(_round_peaks(rest), cv2.filter2D(rest, -1, fit), 0)
        rest = rest - cv2.filter2D(np.maximum(amplitude, 0).astype(np.float32), -1, spot)
    # The median removes pits that remain where a spot was off its pixel centre.
    return np.asarray(cv2.medianBlur(rest, 3), np.float32)


def _spot_and_fit() -> tuple[Image, Image]:
    """The spot (9, 9), and the least-squares filter of its height over a local plane."""
    axis = np.arange(-4, 5, dtype=np.float64)
    x, y = np.meshgrid(axis, axis)
    spot = np.exp(-(x**2 + y**2) / (2 * _DOT_SIGMA_PX**2))
    columns = np.stack([spot.ravel(), np.ones(81), x.ravel(), y.ravel()], axis=1)
    fit = np.linalg.pinv(columns)[0].reshape(9, 9)
    return spot.astype(np.float32), fit.astype(np.float32)


def _round_peaks(image: Image) -> Mask:
    """Maxima of the negative curvature with similar curvature in all directions."""
    smooth = cv2.GaussianBlur(image, (0, 0), 1.0)
    xx = cv2.Sobel(smooth, cv2.CV_32F, 2, 0, ksize=3)
    yy = cv2.Sobel(smooth, cv2.CV_32F, 0, 2, ksize=3)
    xy = cv2.Sobel(smooth, cv2.CV_32F, 1, 1, ksize=3)
    mean, spread = -(xx + yy) / 2, np.sqrt(((xx - yy) / 2) ** 2 + xy**2)
    weaker, stronger = mean - spread, mean + spread
    peak = mean >= cv2.dilate(mean, np.ones((3, 3), np.uint8))
    return peak & (weaker > _ROUNDNESS * stronger) & (weaker > 0)
