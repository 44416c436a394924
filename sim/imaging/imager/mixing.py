"""What crosstalk and averaging make of light: both mix neighbouring pixels, and keep the mean."""

from __future__ import annotations

from starling.sim.imaging.imager import charge, smoothing
from starling.sim.render.layers import Image
from starling.sim.sensor.sensor import Imager


def mixed(part: Imager, light: Image) -> Image:
    """Mix light (h, w) of any unit as an imager does, noise and saturation apart.

    Args:
        part: the imager's electronics.
        light: that falls on it.
    """
    return smoothing.smoothed(charge.crosstalk(light, part.crosstalk), part.smoothing_px)
