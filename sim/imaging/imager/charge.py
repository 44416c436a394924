"""Mean charge: crosstalk, pixel sensitivity (PRNU) and dark current."""

from __future__ import annotations

import cv2
import numba as nb
import numpy as np

from starling.sim.arrays import Image
from starling.sim.imaging.imager.fixed_pattern import Die
from starling.sim.sensor.sensor import Imager


def collect(part: Imager, electrons: Image, exposure_s: float, die: Die) -> Image:
    """Return the mean charge of each pixel at the end of the exposure [electrons] (h, w).

    Args:
        part: the imager.
        electrons: photoelectrons in each pixel's area (h, w).
        exposure_s: integration time [s].
        die: supplies the pixels' sensitivities.
    """
    charge = crosstalk(electrons, part.crosstalk)
    dark = np.float32(part.dark_current_e_s * exposure_s)
    if part.prnu > 0:
        return _sensed(charge, np.float32(part.prnu), die.normal("prnu", charge.shape), dark)
    return charge + dark if dark > 0 else charge


@nb.njit(nogil=True, cache=True)
def _sensed(charge, prnu, pattern, dark):
    out = np.empty_like(charge)
    unity, zero = np.float32(1), np.float32(0)
    for y in range(charge.shape[0]):
        for x in range(charge.shape[1]):
            out[y, x] = charge[y, x] * max(unity + prnu * pattern[y, x], zero) + dark
    return out


def crosstalk(electrons: Image, share: float) -> Image:
    """Move a share of each pixel's electrons to its four neighbours; 0 is the identity.

    The image's total is preserved: electrons that would leave the image stay in the border pixel.
    The diffusion precedes charge collection, so the shot noise of neighbours stays independent.

    Source: Djite et al., IEEE Trans. Electron Devices 59 (2012) 729. Charge diffuses further if
    light is absorbed deeper, so most in the near infrared.
    """
    if share == 0:
        return electrons
    neighbour = share / 4
    kernel = np.array(
        [[0, neighbour, 0], [neighbour, 1 - share, neighbour], [0, neighbour, 0]], np.float32
    )
    mixed = cv2.filter2D(electrons, cv2.CV_32F, kernel, borderType=cv2.BORDER_REPLICATE)
    return np.asarray(mixed, np.float32)
