"""The band-pass filter in front of a lens: transmission and its shift with the angle.

At an angle a, the transmission curve of a thin-film stack shifts to shorter wavelengths. The
factor is s = sqrt(1 - (sin a / n)^2); n is the stack's effective index. Towards the image's
corners a laser therefore leaves the band; broadband light does not.

Source: Smith, Modern Optical Engineering, sec. 11 (the shift); Macleod, Thin-Film Optical
Filters, ch. 7 (n, and bands of coupled cavities); checked against `tests/oracles/multilayer.py`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from starling.patterns import errors
from starling.sim.scene.spectra import silicon, wavelength
from starling.sim.scene.spectra.wavelength import Spectrum

Angles = NDArray[np.floating]
Map = NDArray[np.float32]

NARROWEST_NM = 2.0  # The spectra's grid does not resolve narrower filters.


def check(centre_nm: float, width_nm: float, index: float) -> None:
    """Refuse an impossible filter.

    Raises:
        InputError: if the centre is outside 380 to 1100 nm, the width is neither 0 (no filter)
            nor in 2 to 500 nm, or the index is outside 1 to 5.
    """
    wavelength.in_silicon("filter centre", centre_nm)
    if width_nm != 0:
        errors.in_interval(
            "filter width", width_nm, NARROWEST_NM, 500.0, "Give nanometres; 0 is no filter."
        )
    errors.in_interval("filter index", index, 1.0, 5.0, "Between its layers' indices, 1.5 to 3.5.")


def shift(angle_rad: Angles, index: float) -> Map:
    """Factor s of the passed wavelength at an angle; float32, shape of `angle_rad`."""
    sine = np.sin(np.asarray(angle_rad, np.float32))
    return np.sqrt(np.float32(1) - np.square(sine) * np.float32(1 / index**2))


def transmission(wavelength_nm: Spectrum, *, centre_nm: float, width_nm: float) -> Spectrum:
    """Transmission on the axis over its peak: 1 / (1 + x^6), x = 2 (l - centre) / width.

    This is the flat band of three coupled cavities (Butterworth). It is 1 if the width is 0.
    """
    if width_nm == 0:
        return np.ones_like(wavelength_nm)
    x = 2 * (wavelength_nm - centre_nm) / width_nm
    return 1 / (1 + x**6)


def laser_transmission(
    angle_rad: Angles, *, wavelength_nm: float, centre_nm: float, width_nm: float, index: float
) -> Map:
    """Transmission of the laser at each angle, over the filter's peak.

    Args:
        angle_rad: Angle of incidence on the filter [rad], any shape.
        wavelength_nm: Laser's line [nm].
        centre_nm: Centre of the band on the axis [nm].
        width_nm: Full width at half maximum [nm]; 0 is no filter.
        index: Effective index of the filter.

    Returns:
        In (0, 1], float32, shape of `angle_rad`. Exactly 1 without a filter, and on the axis for a
        laser at the band's centre. A laser below the centre first gains with the angle.

    Raises:
        InputError: if a wavelength, the width or the index is out of range.
    """
    wavelength.in_silicon("laser wavelength", wavelength_nm)
    check(centre_nm, width_nm, index)
    if width_nm == 0:
        return np.ones_like(angle_rad, dtype=np.float32)
    normal_nm = np.float32(wavelength_nm) / shift(angle_rad, index)
    square = np.square((normal_nm - np.float32(centre_nm)) * np.float32(2 / width_nm))
    return np.float32(1) / (np.float32(1) + square * square * square)


def ambient_transmission(
    angle_rad: Angles,
    *,
    centre_nm: float,
    width_nm: float,
    index: float,
    epitaxy_um: float = silicon.PLAIN_UM,
) -> Map:
    """Electrons from light of a flat spectrum at each angle, over those on the axis.

    The band shifts and narrows by s, and a watt has fewer photons by s. But silicon absorbs more
    at shorter wavelengths. Broadband light therefore rises by a tenth or two in corners.

    Args:
        angle_rad: Angle of incidence on the filter [rad], any shape.
        centre_nm: Centre of the band on the axis [nm].
        width_nm: Full width at half maximum [nm]; 0 is no filter.
        index: Effective index of the filter.
        epitaxy_um: Depth of the collecting silicon [um].

    Returns:
        Above 0, float32, shape of `angle_rad`. Exactly 1 on the axis, and without a filter.

    Raises:
        InputError: if the centre, the width or the index is out of range.
    """
    check(centre_nm, width_nm, index)
    if width_nm == 0:
        return np.ones_like(angle_rad, dtype=np.float32)
    less = np.float32(1) - shift(angle_rad, index)
    # A cubic in 1 - s up to 60 deg is as accurate as silicon's table and ten times as fast.
    grid = np.linspace(0.0, 1 - np.sqrt(1 - 0.75 / index**2), 64)
    gain = silicon.absorbed(centre_nm * (1 - grid), epitaxy_um) * (1 - grid) ** 2
    powers = np.stack([grid, grid**2, grid**3], axis=-1)
    fitted, *_ = np.linalg.lstsq(powers, gain / gain[0] - 1, rcond=None)
    linear, square, cube = fitted.astype(np.float32)
    return np.float32(1) + less * (linear + less * (square + less * cube))
