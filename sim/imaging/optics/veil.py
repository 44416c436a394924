"""Veiling glare: light scattered in lens and housing, spread uniformly over the image."""

from __future__ import annotations

import numpy as np

from starling.sim.arrays import Image


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
