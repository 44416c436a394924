"""Veiling glare: light scattered in lens and housing, spread evenly over the image."""

from __future__ import annotations

import numpy as np

from starling.sim.render.layers import Image


def veiled(radiance: Image, share: float) -> Image:
    """Spread a share v of the light over the whole image: (1 - v) L + v mean(L).

    The mean stays; the pedestal has no structure. Light from outside the image is not counted.

    Args:
        radiance: (h, w) [W m^-2 sr^-1].
        share: v, 0 ... 1; 0 is the identity, bit for bit.

    Source: the veiling glare index of ISO 9358 is the level of a small black patch within
    an even bright field, over the field's: v.
    """
    if share == 0:
        return radiance
    out = radiance * np.float32(1 - share)
    out += np.float32(share * radiance.mean(dtype=np.float64))
    return out
