"""Off-axis darkening: vignetting of the lens and blue shift of the band-pass filter.

Both are fixed in the camera's frame. Vignetting dims all light as cos^n of the angle off the axis
(n = 4 for an ideal lens; wide lenses are designed for less). The filter dims the narrow laser line
as its band shifts away, and hardly the broad ambient light. The angle of incidence on the
filter is taken as the angle in front of the lens. Behind the lens the chief ray's angle is smaller.
"""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np

from starling.sim.arrays import Image
from starling.sim.geometry.pinhole import Pinhole
from starling.sim.sensor.sensor import Imager


@lru_cache(maxsize=4)
def vignetting(exponent: float, pinhole: Pinhole) -> Image:
    """Return cos^n of each pixel's angle off the axis, (h, w), read-only.

    Source: Horn, Robot Vision, sec. 10.3 (n = 4).
    """
    secant_squared = 1 + pinhole.tangent_squared()
    return _fixed(np.asarray(cv2.pow(secant_squared, -exponent / 2), np.float32))


def laser(imager: Imager, wavelength_nm: float, pinhole: Pinhole) -> Image:
    """Return the laser's transmission relative to the band's peak on the axis (h, w)."""
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
    """Return the transmission of other light, of uniform spectrum, relative to the axis (h, w)."""
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
    image.setflags(write=False)  # The cache returns the same array to all callers.
    return image
