"""The full well: pixels that hold no more, pixels that are always full, and what spills."""

from __future__ import annotations

import numba as nb
import numpy as np

from starling.sim.imaging.imager.fixed_pattern import Die
from starling.sim.render.layers import Image
from starling.sim.sensor.sensor import Imager


def hot(part: Imager, charge: Image, die: Die) -> Image:
    """Fill the device's hot pixels; none is the identity.

    A device's pixels are hot in an order of its own: a larger share adds to a smaller.
    """
    if part.hot_pixels == 0:
        return charge
    full = np.flatnonzero(die.uniform("hot", charge.shape) < np.float32(part.hot_pixels))
    filled = charge.copy()
    flat = filled.ravel()
    flat[full] = np.maximum(flat[full], np.float32(part.full_well_e))
    return filled


def contained(part: Imager, charge: Image) -> Image:
    """Limit the charge to the full well; with blooming a share of the rest fills its column.

    Of the charge above the full well 1 - `blooming` is drained where it arises. The rest leaves
    half upwards, half downwards, and fills what room it meets until it is used up or leaves the
    image: stored = all - drained - left. Where two streaks want one pixel's room, the downward
    one is first.

    Source: Janesick, Scientific Charge-Coupled Devices (2001): charge above the full
    well runs along its column; the drained share stands for an anti-blooming gate.
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
