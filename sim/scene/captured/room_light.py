"""A captured room's reflectance, and how brightly it is lit besides the projector.

Brightness alone cannot tell light from reflectance. But the projector's light is known, as are the
surfaces that it falls on: how far its dots stand out tells how much other light there is, and with
both known the image's brightness tells reflectance up to a factor.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.sim.imaging.imager import read_out
from starling.sim.imaging.signals import Signals
from starling.sim.scene.captured import dot_removal
from starling.sim.sensor.sensor import Imager

Array = NDArray[np.float32]

LIT_ROOM_W_M2 = 0.4  # Where no dots tell: modulates a D415's dots by the 0.1 to 0.35 of lit rooms.
_DIMMEST, _BRIGHTEST = 0.01, 100.0  # [W m^-2]
_HALVINGS = 8  # Of the logarithm between these: to 4 %.
_EVEN_PX = 12.0  # Sigma over which brightness is made that of the image.
_AROUND_PX = 16.0  # Sigma of the neighbourhood in which dots are weighed: some dots wide.
_MEAN_REFLECTANCE = 0.5  # Assumed: of which factor both are wrong no image tells.
_DARKEST = 0.02  # Share of the median that a division is at least by.


@dataclass(frozen=True, slots=True, eq=False)
class Lit:
    """What an image tells of a room."""

    reflectance: Array  # (h, w)
    ambient_w_m2: float
    ambient_share: Array | None = None  # (h, w), of that, which falls there; None: all of it.


def ambient_w_m2(dotted: Array, light: Signals, imager: Imager) -> float:
    """Irradiance of even ambient light at which dots stand out as much as they do in an image.

    In the middle pixel the light of round spots has the same share of all light around it in the
    image and in one that is made of the light on even surfaces, brightened as the image is and
    with its noise. Which spots lie where does not matter.

    Args:
        dotted: (h, w) image with dots [DN above black].
        light: on surfaces of one reflectance, as the image's imager sees it.
        imager: whose noise the image has.

    Returns:
        From 0.01 to 100 W m^-2; `LIT_ROOM_W_M2` where the projector is off.
    """
    if not light.laser.any():
        return LIT_ROOM_W_M2
    seen, level = _standing_out(dotted), _even(dotted)
    low, high = np.log(_DIMMEST), np.log(_BRIGHTEST)
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        lit = _sum(light, float(np.exp(middle)))
        made = _read_out(lit * _over(level, _even(lit)), imager)
        if np.median(_standing_out(made) - seen) > 0:
            low = middle
        else:
            high = middle
    return float(np.exp(0.5 * (low + high)))


def reflectance(
    level: Array, light: Signals, ambient: float, detail: Callable[[Array], Array]
) -> Array:
    """Reflectance (h, w), 0.5 in the mean, at which the light makes an image's brightness.

    Args:
        level: (h, w) image [DN above black], dots and all.
        light: that lit it, on surfaces of one reflectance.
        ambient: irradiance of ambient light [W m^-2].
        detail: what is kept of an image; no dots.
    """
    return believable(_over(detail(level), detail(_sum(light, ambient))))


def believable(brightness: Array) -> Array:
    """Scale brightness (h, w) to a mean of 0.5, from 0.01 to 0.95."""
    scale = _MEAN_REFLECTANCE / max(float(brightness.mean()), 1e-6)
    return np.clip(brightness * np.float32(scale), 0.01, 0.95).astype(np.float32)


def _standing_out(image: Array) -> Array:
    """Share of the light around each pixel that is of round spots."""
    image = np.asarray(np.maximum(image, 0), np.float32)
    spots = np.asarray(np.maximum(image - dot_removal.removed(image), 0), np.float32)
    return _over(_blurred(spots, _AROUND_PX), _blurred(image, _AROUND_PX))


def _read_out(level_dn: Array, imager: Imager) -> Array:
    """An image [DN above black] with one draw of the imager's noise, in whole codes."""
    electrons = level_dn / np.float32(imager.dn_per_electron)
    read = read_out(
        imager, electrons, exposure_s=imager.exposure_s, unit=0, side="left", seed=0, frame=0
    )
    return read.delivered.astype(np.float32) - np.float32(imager.black_level_dn)


def _even(image: Array) -> Array:
    return _blurred(np.asarray(np.maximum(image, 0), np.float32), _EVEN_PX)


def _blurred(image: Array, sigma_px: float) -> Array:
    return np.asarray(cv2.GaussianBlur(image, (0, 0), sigma_px), np.float32)


def _sum(light: Signals, ambient: float) -> Array:
    lit = light.laser + light.other + ambient * light.ambient
    return np.asarray(lit, np.float32)


def _over(one: Array, other: Array) -> Array:
    """One image over another, which is taken for no darker than a share of its own median."""
    least = max(_DARKEST * float(np.median(other)), 1e-30)
    return np.asarray(one / np.maximum(other, least), np.float32)
