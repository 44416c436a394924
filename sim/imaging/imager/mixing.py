"""Crosstalk and averaging, which mix neighbouring pixels and preserve the mean."""

from __future__ import annotations

from starling.sim.arrays import Image
from starling.sim.imaging.imager import charge, smoothing
from starling.sim.sensor.sensor import Imager


def mix_pixels(part: Imager, light: Image) -> Image:
    """Apply an imager's crosstalk and averaging to light (h, w), without noise or saturation.

    Args:
        part: the imager's electronics.
        light: light on the imager, in any unit.
    """
    return smoothing.smooth(charge.crosstalk(light, part.crosstalk), part.smoothing_px)
