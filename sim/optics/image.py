"""The image that a lens forms: the stages of the optics in their order."""

from __future__ import annotations

from typing import Literal

import numpy as np

from sim.layers import Image
from sim.light.received import Received
from sim.optics import blur
from sim.sensor import Sensor


def image(
    light: Received, depth_m: Image, sensor: Sensor, side: Literal["left", "right"], *, seed: int
) -> Image:
    """Form the image of one imager.

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
    lens = (sensor.left if side == "left" else sensor.right).lens
    return blur.blur(np.asarray(light.laser + light.rest), lens.blur_px)
