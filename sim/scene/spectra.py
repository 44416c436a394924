"""Equivalent irradiance at the laser's wavelength of sun and lamps, from their spectra.

A scene's ambient light is one irradiance E_0 at the laser's line l_0. It gives as many electrons as
the light's spectrum E:

    E_0 = integral of E(l) T(l) Q(l) l dl / (Q(l_0) l_0)

T is the filter's transmission over its peak, Q silicon's quantum efficiency. Photons are counted,
so each watt is weighted by its wavelength (EMVA Standard 1288, release 4.0, eq. 2). The optics
account for the loss of a laser off the filter's centre (`laser_transmission`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from starling.patterns import errors
from starling.sim.imaging.optics import bandpass
from starling.sim.imaging.optics.bandpass import GRID_NM, Spectrum, integral

if TYPE_CHECKING:
    from starling.sim.sensor.sensor import Imager, Projector


LUMENS_PER_WATT = 683.0  # K_m at 555 nm (CIE; SI Brochure, 9th ed., 683.002).
_SUN_NM = np.arange(380.0, 1101.0, 5.0)
# fmt: off
# Global irradiance on a surface tilted by 37 deg at air mass 1.5, means over 5 nm from 380 nm on
# [W m^-2 nm^-1]. Source: ASTM G173-03 (SMARTS 2.9.2), 1000.4 W m^-2 in all.
_SUN = np.array([
    0.724, 0.583, 0.748, 0.609, 1.074, 1.146, 1.168, 1.22, 1.212, 1.214, 1.051, 1.272, 1.306,
    1.423, 1.544, 1.531, 1.561, 1.553, 1.554, 1.577, 1.613, 1.492, 1.532, 1.587, 1.531, 1.551,
    1.568, 1.476, 1.486, 1.512, 1.574, 1.532, 1.511, 1.545, 1.541, 1.538, 1.5, 1.506, 1.486,
    1.494, 1.497, 1.528, 1.412, 1.457, 1.459, 1.483, 1.474, 1.441, 1.463, 1.413, 1.393, 1.438,
    1.448, 1.435, 1.389, 1.327, 1.386, 1.407, 1.418, 1.405, 1.397, 1.293, 1.183, 1.277, 1.286,
    1.305, 1.311, 1.245, 1.053, 1.082, 1.09, 1.211, 1.213, 1.246, 1.234, 1.231, 0.698, 0.69,
    1.146, 1.177, 1.168, 1.155, 1.11, 1.089, 1.088, 1.077, 1.054, 0.898, 0.902, 0.903, 0.908,
    0.973, 1.005, 1.004, 0.963, 0.939, 0.991, 0.942, 0.958, 0.947, 0.934, 0.925, 0.922, 0.795,
    0.654, 0.753, 0.666, 0.646, 0.716, 0.728, 0.46, 0.196, 0.366, 0.3, 0.338, 0.344, 0.429, 0.497,
    0.669, 0.598, 0.653, 0.717, 0.744, 0.747, 0.737, 0.716, 0.721, 0.713, 0.699, 0.694, 0.689,
    0.679, 0.673, 0.661, 0.656, 0.647, 0.629, 0.624, 0.608, 0.608, 0.595, 0.579, 0.577, 0.53,
    0.494,
])
# fmt: on


@dataclass(frozen=True, kw_only=True, slots=True)
class Band:
    """Spectral band of an imager. The lens passes 380 to 1100 nm evenly."""

    wavelength_nm: float = 850.0  # The laser's line.
    filter_centre_nm: float = 850.0  # Centre of the band-pass on the axis.
    filter_width_nm: float = 0.0  # Full width at half maximum; 0 is no filter.
    epitaxy_um: float = bandpass.PLAIN_UM  # Depth of the collecting silicon; infinite is ideal.

    def __post_init__(self) -> None:
        bandpass.in_silicon("band.wavelength_nm", self.wavelength_nm)
        bandpass.check(self.filter_centre_nm, self.filter_width_nm, 2.0)
        if self.epitaxy_um != float("inf"):
            errors.positive("band.epitaxy_um", self.epitaxy_um, "Give micrometres.")
        at_laser = self._transmission(np.array([self.wavelength_nm]))[0]
        if at_laser < 1e-3:
            raise errors.refuse(
                "band.filter_centre_nm",
                f"must let the laser's {self.wavelength_nm:g} nm pass",
                f"{self.filter_centre_nm:g} nm, {self.filter_width_nm:g} nm wide",
                "Centre the filter on the laser or widen it.",
            )

    @classmethod
    def from_imager(cls, imager: Imager, projector: Projector) -> Band:
        """Derive the band from an imager's filter and its quantum efficiency at the laser's line.

        The efficiency determines the depth of the silicon.
        """
        return cls(
            wavelength_nm=projector.wavelength_nm,
            filter_centre_nm=imager.lens.filter_centre_nm,
            filter_width_nm=imager.lens.filter_width_nm,
            epitaxy_um=bandpass.depth_um(imager.quantum_efficiency, projector.wavelength_nm),
        )

    def _transmission(self, wavelength_nm: Spectrum) -> Spectrum:
        return bandpass.transmission(
            wavelength_nm, centre_nm=self.filter_centre_nm, width_nm=self.filter_width_nm
        )

    def _per_watt(self, wavelength_nm: Spectrum) -> Spectrum:
        return bandpass.absorbed(wavelength_nm, self.epitaxy_um) * wavelength_nm

    @property
    def response(self) -> Spectrum:
        """Electrons per watt on `GRID_NM` (1441,), over those at the laser's line unfiltered."""
        unfiltered = self._per_watt(GRID_NM) / self._per_watt(np.array([self.wavelength_nm]))
        return self._transmission(GRID_NM) * unfiltered


def in_band_irradiance(spectrum: Spectrum, band: Band) -> float:
    """Irradiance at the laser's line that gives as many electrons as a spectrum [W m^-2].

    Args:
        spectrum: E on `starling.sim.imaging.optics.bandpass.GRID_NM` (1441,) [W m^-2 nm^-1].
        band: Spectral band of the imager.

    Raises:
        InputError: if the spectrum is not on the grid, or is negative or NaN anywhere.
    """
    if spectrum.shape != GRID_NM.shape or not (spectrum >= 0).all():
        raise errors.refuse(
            "spectrum",
            f"must be {GRID_NM.shape} numbers >= 0",
            f"{spectrum.shape}, least {spectrum.min() if spectrum.size else 'none'}",
            "Interpolate it to starling.sim.imaging.optics.bandpass.GRID_NM.",
        )
    return integral(spectrum * band.response)


def ambient_w_m2(light: str, *, illuminance_lx: float, band: Band) -> float:
    """Equivalent ambient irradiance at the laser's line of a light [W m^-2].

    Args:
        light: `sun`, `incandescent`, `led` or `fluorescent`.
        illuminance_lx: Illuminance of the surface [lx].
        band: Spectral band of the imager.

    Raises:
        InputError: if the light is unknown or the illuminance out of range.

    Example:
        >>> filtered = Band(filter_width_nm=50.0)
        >>> round(ambient_w_m2("sun", illuminance_lx=50e3, band=filtered))
        23
    """
    return in_band_irradiance(irradiance(light, illuminance_lx), band)


def _sun() -> Spectrum:
    return np.interp(GRID_NM, _SUN_NM, _SUN)


def _incandescent() -> Spectrum:
    """Planck's law at CIE illuminant A's temperature, to first order a tungsten lamp."""
    from colour.colorimetry import planck_law

    return np.asarray(planck_law(GRID_NM * 1e-9, 2856.0), np.float64)


def _led() -> Spectrum:
    """CIE LED-B3 (blue pump and phosphor, 4103 K), extrapolated beyond its end at 780 nm."""
    wavelength_nm, power = _tabulated("LED-B3")
    slope, level = np.polyfit(wavelength_nm[-9:], np.log(power[-9:]), 1)  # Slope of the last 40 nm.
    tail = np.exp(level + slope * GRID_NM)
    inside_nm = wavelength_nm[-1] >= GRID_NM
    return np.where(inside_nm, np.interp(GRID_NM, wavelength_nm, power), tail)


def _fluorescent() -> Spectrum:
    """CIE FL2 (cool white); zero beyond 780 nm, where argon has weak lines."""
    wavelength_nm, power = _tabulated("FL2")
    return np.interp(GRID_NM, wavelength_nm, power, right=0.0)


def _tabulated(name: str) -> tuple[Spectrum, Spectrum]:
    from colour import SDS_ILLUMINANTS

    table = SDS_ILLUMINANTS[name]
    return np.asarray(table.wavelengths, np.float64), np.asarray(table.values, np.float64)


_SHAPES: dict[str, Callable[[], Spectrum]] = {
    "sun": _sun,
    "incandescent": _incandescent,
    "led": _led,
    "fluorescent": _fluorescent,
}


def names() -> list[str]:
    """List the lights."""
    return sorted(_SHAPES)


@lru_cache(maxsize=1)
def luminous_efficiency() -> Spectrum:
    """Luminous efficiency V on `GRID_NM` (1441,), 1 at 555 nm (CIE 1924 observer)."""
    from colour import SDS_LEFS

    table = SDS_LEFS["CIE 1924 Photopic Standard Observer"]
    return np.interp(GRID_NM, table.wavelengths, table.values, right=0.0)


def illuminance_lx(spectrum: Spectrum) -> float:
    """Illuminance [lx]: 683 times the integral of V E.

    Args:
        spectrum: E on `GRID_NM` (1441,) [W m^-2 nm^-1].
    """
    return LUMENS_PER_WATT * integral(luminous_efficiency() * spectrum)


@lru_cache(maxsize=len(_SHAPES))
def _at_one_lux(light: str) -> Spectrum:
    shape = _SHAPES[light]()
    return shape / illuminance_lx(shape)


def irradiance(light: str, illuminance: float) -> Spectrum:
    """Spectral irradiance of a light of given illuminance.

    Args:
        light: One of `names()`.
        illuminance: 0 to 150 000 [lx]; an office has 500, direct sun 100 000.

    Returns:
        (1441,) on `GRID_NM` [W m^-2 nm^-1].

    Raises:
        InputError: if the light is unknown or the illuminance out of range.
    """
    errors.one_of("light", light, _SHAPES)
    errors.in_interval(
        "illuminance_lx", illuminance, 0.0, 1.5e5, "Give lux: direct sun has 1e5, an office 500."
    )
    return _at_one_lux(light) * illuminance
