"""Visible colours, and near-infrared reflectances that they hint at."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from starling.sim.arrays import Image

DARKEST = 0.25  # Near-infrared reflectance of what is black to the eye.
RISE = 0.6  # Rise to what is white.


def linear(levels: NDArray[np.uint8]) -> Image:
    """Linear light of sRGB bytes (IEC 61966-2-1), of any shape."""
    level = np.arange(256) / 255
    table = np.where(level <= 0.04045, level / 12.92, ((level + 0.055) / 1.055) ** 2.4)
    return table.astype(np.float32)[levels]


def near_infrared(rgb: NDArray[np.floating]) -> Image:
    """Reflectance (...) at 850 nm of linear visible reflectances (..., 3): 0.25 + 0.6 max(rgb).

    It is a guess: dyes that absorb visible light are bright at 850 nm (`docs/materials.md`).
    """
    brightest = np.asarray(rgb, np.float32).max(-1)
    return brightest * np.float32(RISE) + np.float32(DARKEST)
