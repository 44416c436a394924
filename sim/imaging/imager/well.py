"""The full well: hot pixels, saturation and blooming."""

from __future__ import annotations

import numba as nb
import numpy as np

from starling.sim.arrays import Image
from starling.sim.imaging.imager.fixed_pattern import Die
from starling.sim.sensor.sensor import Imager


def fill_hot_pixels(part: Imager, charge: Image, die: Die) -> Image:
    """Fill the device's hot pixels; a share of 0 is the identity.

    The hot pixels of a smaller share are a subset of those of a larger share.
    """
    if part.hot_pixels == 0:
        return charge
    full = np.flatnonzero(die.uniform("hot", charge.shape) < np.float32(part.hot_pixels))
    filled = charge.copy()
    flat = filled.ravel()
    flat[full] = np.maximum(flat[full], np.float32(part.full_well_e))
    return filled


def limit_to_full_well(part: Imager, charge: Image) -> Image:
    """Limit the charge to the full well; with blooming, part of the excess fills its column.

    The share 1 - `blooming` of the excess charge is drained in its pixel. Half of the remaining
    charge moves upwards, half downwards. It fills the free capacity of the pixels on its way, until
    it is used up or leaves the image. Where two streaks meet, the downward one fills first.

    Source: Janesick, Scientific Charge-Coupled Devices (2001). Charge above the full well runs
    along its column; the drained share models an anti-blooming gate.
    """
    full = np.float32(part.full_well_e)
    if part.blooming == 0 or charge.max() <= full:
        return np.minimum(charge, full)
    return _spilled(charge, full, np.float32(part.blooming / 2))


@nb.njit(nogil=True, cache=True)
def _spilled(charge, full, half):
    height, width = charge.shape
    out = charge.copy()
    down, up = np.zeros(width, charge.dtype), np.zeros(width, charge.dtype)
    for y in range(height):
        for x in range(width):
            held = out[y, x]
            if held > full:
                down[x] += half * (held - full)
            elif down[x] > 0:
                taken = min(down[x], full - held)
                out[y, x] = held + taken
                down[x] -= taken
    for row in range(height):
        y = height - 1 - row
        for x in range(width):
            held = out[y, x]
            if charge[y, x] > full:
                up[x] += half * (charge[y, x] - full)
            elif up[x] > 0:
                taken = min(up[x], max(full - held, np.float32(0)))
                held += taken
                up[x] -= taken
            out[y, x] = min(held, full)
    return out
