"""The image that a lens forms: all stages of the optics in order."""

from __future__ import annotations

from typing import Literal

import numpy as np

from starling.sim.arrays import Image
from starling.sim.geometry.pinhole import Pinhole
from starling.sim.imaging.imager.charge import Die
from starling.sim.imaging.lens_input import LensInput
from starling.sim.imaging.optics import alignment, shading, speckle, spot
from starling.sim.sensor.sensor import Imager, Sensor


def image(
    light: LensInput, depth_m: Image, sensor: Sensor, side: Literal["left", "right"], *, seed: int
) -> Image:
    """Form the image of one imager: spot, alignment, speckle, vignetting, filter, veiling glare.

    Laser light and other light are processed separately only with speckle or a band-pass filter.
    Speckle forms on the imager, so it follows the lens's spot.

    Args:
        light: light at the imager's lens.
        depth_m: (h, w) z of the surface in each pixel [m], NaN without a surface.
        sensor: its geometry, projector and imagers.
        side: which imager.
        seed: seed of the capture, for speckle.

    Returns:
        (h, w) radiance [W m^-2 sr^-1] at the laser's wavelength that gives the same image through
        an ideal lens of the same aperture.
    """
    imager = sensor.left if side == "left" else sensor.right
    pinhole = Pinhole.from_camera(sensor)
    separate = sensor.projector.speckle_contrast > 0 or imager.lens.filter_width_nm > 0
    parts = (light.laser, light.rest) if separate else (np.asarray(light.laser + light.rest),)
    parts = spot.blur_by_spot(parts, depth_m, imager.lens, pinhole)
    parts = alignment.misalign(parts, imager.alignment, pinhole, Die(sensor.unit, side))
    if separate:
        laser, rest = parts
        laser = speckle.apply_speckle(laser, imager, sensor.projector, side, seed=seed)
        formed = _filtered(laser, rest, imager, sensor.projector.wavelength_nm, pinhole)
    else:
        formed = parts[0]
        if imager.lens.vignetting > 0:
            formed = formed * shading.vignetting(imager.lens.vignetting, pinhole)
    return add_veiling_glare(formed, imager.lens.veil)


def _filtered(
    laser: Image, rest: Image, imager: Imager, wavelength_nm: float, pinhole: Pinhole
) -> Image:
    """Apply vignetting and filter to both lights and add them (h, w)."""
    if imager.lens.filter_width_nm == 0:
        formed = laser + rest
        if imager.lens.vignetting > 0:
            formed *= shading.vignetting(imager.lens.vignetting, pinhole)
        return formed
    formed = laser * shading.laser(imager.lens, wavelength_nm, pinhole)
    formed += rest * shading.rest(imager.lens, imager.quantum_efficiency, wavelength_nm, pinhole)
    return formed


def add_veiling_glare(radiance: Image, share: float) -> Image:
    """Spread a share v of the light over the whole image: (1 - v) L + v mean(L).

    The mean is unchanged and the pedestal has no structure. Light from outside the image is not
    modelled.

    Args:
        radiance: (h, w) [W m^-2 sr^-1].
        share: v, 0 ... 1; 0 is the identity, bit for bit.

    Source: ISO 9358. The veiling glare index v is the level of a small black patch within a uniform
    bright field, relative to the field.
    """
    if share == 0:
        return radiance
    out = radiance * np.float32(1 - share)
    out += np.float32(share * radiance.mean(dtype=np.float64))
    return out
