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

from starling.sim.arrays import Image
from starling.sim.imaging.imager import read_out
from starling.sim.imaging.signals import Signals
from starling.sim.scene.captured import dot_removal
from starling.sim.sensor.sensor import Imager

# Default without dots [W m^-2]. It gives a D415's dots the contrast of lit rooms, 0.1 to 0.35.
LIT_ROOM_W_M2 = 0.4
_DIMMEST, _BRIGHTEST = 0.01, 100.0  # Search range of ambient light [W m^-2].
_HALVINGS = 8  # Bisections of the logarithm of this range; they give 4 %.
_EVEN_PX = 12.0  # Sigma at which the model's brightness is matched to the image's [px].
_AROUND_PX = 16.0  # Sigma of the neighbourhood of dot contrast, a few dots wide [px].
_MEAN_REFLECTANCE = 0.5  # Assumed, because an image gives reflectance only up to a factor.
_DARKEST = 0.02  # Least divisor, relative to the median.


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
    spots = np.asarray(np.maximum(image - dot_removal.remove_dots(image), 0), np.float32)
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
