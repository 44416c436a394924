"""The image that a lens forms: the stages of the optics in their order."""

from __future__ import annotations

from typing import Literal

import numpy as np

from starling.sim.geometry.pinhole import Pinhole
from starling.sim.imaging.lens_input import Received
from starling.sim.imaging.optics import alignment, shading, speckle, spot, veil
from starling.sim.render.layers import Image
from starling.sim.sensor.sensor import Imager, Sensor


def image(
    light: Received, depth_m: Image, sensor: Sensor, side: Literal["left", "right"], *, seed: int
) -> Image:
    """Form the image of one imager: spot, alignment, speckle, vignetting and filter, veil.

    Laser light is kept apart from the rest only where something tells them apart: speckle, which
    forms on the imager and so comes after the lens's spot, or a band-pass filter.

    Args:
        light: what reaches its lens.
        depth_m: (h, w) z of what each pixel sees [m], NaN where there is nothing.
        sensor: its geometry, projector and imagers.
        side: which of the imagers.
        seed: of the capture, for what is drawn once a capture.

    Returns:
        (h, w) radiance that would, through an ideal lens of the same aperture, give the same
        image [W m^-2 sr^-1], counted at the laser's wavelength.
    """
    imager = sensor.left if side == "left" else sensor.right
    pinhole = Pinhole.of(sensor)
    apart = sensor.projector.speckle_contrast > 0 or imager.lens.filter_width_nm > 0
    parts = (light.laser, light.rest) if apart else (np.asarray(light.laser + light.rest),)
    parts = spot.blurred(parts, depth_m, imager.lens, pinhole)
    parts = alignment.moved(parts, imager.alignment, pinhole)
    if apart:
        laser, rest = parts
        laser = speckle.grained(laser, imager, sensor.projector, side, seed=seed)
        formed = _filtered(laser, rest, imager, sensor.projector.wavelength_nm, pinhole)
    else:
        formed = parts[0]
        if imager.lens.vignetting > 0:
            formed = formed * shading.vignetting(imager.lens.vignetting, pinhole)
    return veil.veiled(formed, imager.lens.veil)


def _filtered(
    laser: Image, rest: Image, imager: Imager, wavelength_nm: float, pinhole: Pinhole
) -> Image:
    """Dim both lights by the way they take through lens and filter, and add them (h, w)."""
    if imager.lens.filter_width_nm == 0:
        formed = laser + rest
        if imager.lens.vignetting > 0:
            formed *= shading.vignetting(imager.lens.vignetting, pinhole)
        return formed
    formed = laser * shading.laser(imager, wavelength_nm, pinhole)
    formed += rest * shading.rest(imager, wavelength_nm, pinhole)
    return formed
