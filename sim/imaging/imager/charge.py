"""Mean charge: where the light's electrons end, and those that no light made."""

from __future__ import annotations

import cv2
import numba as nb
import numpy as np

from starling.sim.imaging.imager.fixed_pattern import Die
from starling.sim.render.layers import Image
from starling.sim.sensor.sensor import Imager


def collected(part: Imager, electrons: Image, exposure_s: float, die: Die) -> Image:
    """Mean charge of each pixel at the end of the exposure [electrons] (h, w).

    Args:
        part: the imager.
        electrons: that the light makes in each pixel's area (h, w).
        exposure_s: integration time [s].
        die: whose pixels' sensitivities count.
    """
    charge = crosstalk(electrons, part.crosstalk)
    dark = np.float32(part.dark_current_e_s * exposure_s)
    if part.prnu > 0:
        return _sensed(charge, np.float32(part.prnu), die.normal("prnu", charge.shape), dark)
    return charge + dark if dark > 0 else charge


@nb.njit(nogil=True, cache=True)
def _sensed(charge, prnu, pattern, dark):
    out = np.empty_like(charge)
    one, none = np.float32(1), np.float32(0)
    for y in range(charge.shape[0]):
        for x in range(charge.shape[1]):
            out[y, x] = charge[y, x] * max(one + prnu * pattern[y, x], none) + dark
    return out


def crosstalk(electrons: Image, share: float) -> Image:
    """Let a share of each pixel's electrons end in its four neighbours; 0 is the identity.

    The image's total is kept: what would leave at the border stays in the border's pixel. It is
    diffusion before the charge is counted, so the shot noise of neighbours stays independent.

    Source: Djite et al., IEEE Trans. Electron Devices 59 (2012) 729: charge diffuses further the
    deeper light is absorbed, so most in the near infrared.
    """
    if share == 0:
        return electrons
    beside = share / 4
    kernel = np.array([[0, beside, 0], [beside, 1 - share, beside], [0, beside, 0]], np.float32)
    mixed = cv2.filter2D(electrons, cv2.CV_32F, kernel, borderType=cv2.BORDER_REPLICATE)
    return np.asarray(mixed, np.float32)
