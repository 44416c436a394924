"""The band-pass filter in front of a lens and the silicon behind it, over wavelength and angle.

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

Spectrum = NDArray[np.float64]

SHORTEST_NM, LONGEST_NM = 380.0, 1100.0  # Limits of lenses and of silicon.
GRID_NM: Spectrum = np.linspace(SHORTEST_NM, LONGEST_NM, 1441)  # Every half nanometre.

# Depth of the collecting layer [um], assumed because makers do not publish it. It collects 0.23 of
# the photons at 850 nm, about as the ordinary version of a chip.
PLAIN_UM = 5.0
# Share of photons that enter and can be collected (reflection, fill factor), the highest possible
# quantum efficiency. Assumed, and equal at all wavelengths.
COLLECTED = 0.75
_K_NM = np.arange(380.0, 1101.0, 10.0)
# fmt: off
# Extinction coefficient k of intrinsic silicon at 300 K, times 1000, every 10 nm from 380.
# Source: Green, Solar Energy Materials and Solar Cells 92 (2008) 1305, table 1.
_K = 1e-3 * np.array([
    946.0, 445.0, 296.0, 227.0, 176.0, 138.0, 107.0, 86.3, 71.38, 62.09, 55.0, 49.13, 44.17,
    39.37, 36.42, 33.11, 30.29, 27.97, 25.76, 24.13, 22.52, 21.08, 19.93, 18.45, 17.37, 16.44,
    15.43, 14.43, 13.5, 12.74, 11.91, 11.2, 10.53, 10.06, 9.626, 8.946, 8.362, 7.819, 7.197, 6.74,
    6.393, 5.834, 5.411, 4.995, 4.613, 4.273, 3.944, 3.612, 3.278, 2.984, 2.682, 2.429, 2.17,
    1.962, 1.757, 1.547, 1.369, 1.179, 1.024, 0.8722, 0.7487, 0.6224, 0.5093, 0.4107, 0.3239,
    0.2475, 0.187, 0.1362, 0.09363, 0.06812, 0.05328, 0.04077, 0.03064,
])
# fmt: on
Angles = NDArray[np.floating]
Map = NDArray[np.float32]
NARROWEST_NM = 2.0  # The spectra's grid does not resolve narrower filters.


def in_silicon(name: str, value_nm: float) -> None:
    """Refuse a wavelength outside silicon's range, mostly one in a wrong unit.

    Raises:
        InputError: if `value_nm` is outside 380 to 1100 nm.
    """
    remedy = "Give nanometres."
    if isinstance(value_nm, (int, float)):
        for factor, unit in ((1e3, "micrometres"), (1e9, "metres"), (1e-3, "picometres")):
            if SHORTEST_NM <= value_nm * factor <= LONGEST_NM:
                remedy = f"In nanometres these {unit} are {value_nm * factor:g}."
    errors.in_interval(name, value_nm, SHORTEST_NM, LONGEST_NM, remedy)


def integral(spectrum: Spectrum) -> float:
    """Integrate a spectrum on `GRID_NM` (1441,) over wavelength."""
    return float(np.trapezoid(spectrum, GRID_NM))


def absorption_per_um(wavelength_nm: Spectrum) -> Spectrum:
    """Absorption coefficient 4 pi k / lambda [1 / um], by interpolation of log k."""
    log_k = np.interp(wavelength_nm, _K_NM, np.log(_K))
    return 4 * np.pi * np.exp(log_k) / (wavelength_nm * 1e-3)


def absorbed(wavelength_nm: Spectrum, epitaxy_um: float) -> Spectrum:
    """Share of the entering photons absorbed within a depth (Beer-Lambert).

    Args:
        wavelength_nm: 380 to 1100 [nm].
        epitaxy_um: Depth [um], above 0; infinite gives an ideal detector.
    """
    return -np.expm1(-absorption_per_um(wavelength_nm) * epitaxy_um)


def depth_um(efficiency: float, wavelength_nm: float) -> float:
    """Depth of the layer with this quantum efficiency at this wavelength [um].

    Infinite if the efficiency reaches `COLLECTED`: an ideal detector, equally efficient at all
    wavelengths.

    Raises:
        InputError: if the efficiency is not in (0, 1].
    """
    errors.in_interval("quantum efficiency", efficiency, 1e-6, 1.0, "Give a share, not percent.")
    if efficiency >= COLLECTED:
        return float("inf")
    per_um = float(absorption_per_um(np.array([wavelength_nm]))[0])
    return float(-np.log1p(-efficiency / COLLECTED)) / per_um


def check(centre_nm: float, width_nm: float, index: float) -> None:
    """Refuse an impossible filter.

    Raises:
        InputError: if the centre is outside 380 to 1100 nm, the width is neither 0 (no filter)
            nor in 2 to 500 nm, or the index is outside 1 to 5.
    """
    in_silicon("filter centre", centre_nm)
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
    in_silicon("laser wavelength", wavelength_nm)
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
    epitaxy_um: float = PLAIN_UM,
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
    gain = absorbed(centre_nm * (1 - grid), epitaxy_um) * (1 - grid) ** 2
    powers = np.stack([grid, grid**2, grid**3], axis=-1)
    fitted, *_ = np.linalg.lstsq(powers, gain / gain[0] - 1, rcond=None)
    linear, square, cube = fitted.astype(np.float32)
    return np.float32(1) + less * (linear + less * (square + less * cube))
