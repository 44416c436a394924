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
from starling.sim.imaging.optics import bandpass
from starling.sim.sensor.imager import Lens


@lru_cache(maxsize=4)
def vignetting(exponent: float, pinhole: Pinhole) -> Image:
    """Return cos^n of each pixel's angle off the axis, (h, w), read-only.

    Source: Horn, Robot Vision, sec. 10.3 (n = 4).
    """
    secant_squared = 1 + pinhole.tangent_squared()
    return _fixed(np.asarray(cv2.pow(secant_squared, -exponent / 2), np.float32))


@lru_cache(maxsize=4)
def laser(lens: Lens, wavelength_nm: float, pinhole: Pinhole) -> Image:
    """Return the laser's transmission relative to the band's peak on the axis (h, w), read-only."""
    passed = bandpass.laser_transmission(
        pinhole.angle(),
        wavelength_nm=wavelength_nm,
        centre_nm=lens.filter_centre_nm,
        width_nm=lens.filter_width_nm,
        index=lens.filter_index,
    )
    return _fixed(passed * vignetting(lens.vignetting, pinhole))


@lru_cache(maxsize=4)
def rest(lens: Lens, quantum_efficiency: float, wavelength_nm: float, pinhole: Pinhole) -> Image:
    """Return the transmission of other light, of uniform spectrum, relative to the axis (h, w).

    Args:
        lens: supplies filter and vignetting.
        quantum_efficiency: the imager's, at the laser's wavelength.
        wavelength_nm: the laser's wavelength [nm].
        pinhole: intrinsics of the image.
    """
    passed = bandpass.ambient_transmission(
        pinhole.angle(),
        centre_nm=lens.filter_centre_nm,
        width_nm=lens.filter_width_nm,
        index=lens.filter_index,
        epitaxy_um=bandpass.depth_um(quantum_efficiency, wavelength_nm),
    )
    return _fixed(passed * vignetting(lens.vignetting, pinhole))


def _fixed(image: Image) -> Image:
    image.setflags(write=False)  # The cache returns the same array to all callers.
    return image
