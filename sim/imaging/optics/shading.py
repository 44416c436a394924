"""How an image darkens off the axis: the lens's vignetting and the filter's blue shift.

Both are fixed in the camera's frame. Vignetting dims all light as cos^n of the angle off the axis
(n = 4 for an ideal lens; wide lenses are built to have less). The filter dims the laser, whose line
it leaves, and little the broad ambient light. The angle at which light meets the filter is
taken as the angle in front of the lens: a filter behind it sees the chief ray's smaller one.
"""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np

from starling.sim.geometry.pinhole import Pinhole
from starling.sim.render.layers import Image
from starling.sim.sensor.sensor import Imager


@lru_cache(maxsize=4)
def vignetting(exponent: float, pinhole: Pinhole) -> Image:
    """cos^n of each pixel's angle off the axis, (h, w), read-only.

    Source: Horn, Robot Vision, sec. 10.3 (n = 4).
    """
    secant_squared = 1 + pinhole.tangent_squared()
    return _fixed(np.asarray(cv2.pow(secant_squared, -exponent / 2), np.float32))


def laser(imager: Imager, wavelength_nm: float, pinhole: Pinhole) -> Image:
    """Share of the laser's light that arrives, over that of the band's peak on the axis (h, w)."""
    lens = imager.lens
    return _laser(
        lens.vignetting,
        wavelength_nm,
        lens.filter_centre_nm,
        lens.filter_width_nm,
        lens.filter_index,
        pinhole,
    )


def rest(imager: Imager, wavelength_nm: float, pinhole: Pinhole) -> Image:
    """Likewise of all other light, which is of an even spectrum, over that on the axis (h, w)."""
    lens = imager.lens
    return _rest(
        lens.vignetting,
        lens.filter_centre_nm,
        lens.filter_width_nm,
        lens.filter_index,
        imager.quantum_efficiency,
        wavelength_nm,
        pinhole,
    )


@lru_cache(maxsize=4)
def _laser(
    exponent: float,
    wavelength_nm: float,
    centre_nm: float,
    width_nm: float,
    index: float,
    pinhole: Pinhole,
) -> Image:
    from starling.sim.scene import spectra

    passed = spectra.laser_transmission(
        pinhole.angle(),
        wavelength_nm=wavelength_nm,
        centre_nm=centre_nm,
        width_nm=width_nm,
        index=index,
    )
    return _fixed(passed * vignetting(exponent, pinhole))


@lru_cache(maxsize=4)
def _rest(
    exponent: float,
    centre_nm: float,
    width_nm: float,
    index: float,
    efficiency: float,
    wavelength_nm: float,
    pinhole: Pinhole,
) -> Image:
    from starling.sim.scene import spectra
    from starling.sim.scene.spectra import silicon

    passed = spectra.ambient_transmission(
        pinhole.angle(),
        centre_nm=centre_nm,
        width_nm=width_nm,
        index=index,
        epitaxy_um=silicon.depth_um(efficiency, wavelength_nm),
    )
    return _fixed(passed * vignetting(exponent, pinhole))


def _fixed(image: Image) -> Image:
    image.setflags(write=False)  # Shared by all who ask.
    return image
