"""Equivalent irradiance of a light at the laser's wavelength, from its spectrum.

A scene's ambient light is one irradiance E_0 at the laser's line l_0. It gives as many electrons as
the light's spectrum E:

    E_0 = integral of E(l) T(l) Q(l) l dl / (Q(l_0) l_0)

T is the filter's transmission over its peak, Q silicon's quantum efficiency. Photons are counted,
so each watt is weighted by its wavelength (EMVA Standard 1288, release 4.0, eq. 2). The optics
account for the loss of a laser off the filter's centre (`laser_transmission`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from starling.patterns import errors
from starling.sim.scene.spectra import bandpass, illuminants, silicon, wavelength
from starling.sim.scene.spectra.wavelength import GRID_NM, Spectrum, integral

if TYPE_CHECKING:
    from starling.sim.sensor.sensor import Imager, Projector


@dataclass(frozen=True, kw_only=True, slots=True)
class Band:
    """Spectral band of an imager. The lens passes 380 to 1100 nm evenly."""

    wavelength_nm: float = 850.0  # The laser's line.
    filter_centre_nm: float = 850.0  # Centre of the band-pass on the axis.
    filter_width_nm: float = 0.0  # Full width at half maximum; 0 is no filter.
    epitaxy_um: float = silicon.PLAIN_UM  # Depth of the collecting silicon; infinite is ideal.

    def __post_init__(self) -> None:
        wavelength.in_silicon("band.wavelength_nm", self.wavelength_nm)
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
            epitaxy_um=silicon.depth_um(imager.quantum_efficiency, projector.wavelength_nm),
        )

    def _transmission(self, wavelength_nm: Spectrum) -> Spectrum:
        return bandpass.transmission(
            wavelength_nm, centre_nm=self.filter_centre_nm, width_nm=self.filter_width_nm
        )

    def _per_watt(self, wavelength_nm: Spectrum) -> Spectrum:
        return silicon.absorbed(wavelength_nm, self.epitaxy_um) * wavelength_nm

    @property
    def response(self) -> Spectrum:
        """Electrons per watt on `GRID_NM` (1441,), over those at the laser's line unfiltered."""
        unfiltered = self._per_watt(GRID_NM) / self._per_watt(np.array([self.wavelength_nm]))
        return self._transmission(GRID_NM) * unfiltered


def in_band_irradiance(spectrum: Spectrum, band: Band) -> float:
    """Irradiance at the laser's line that gives as many electrons as a spectrum [W m^-2].

    Args:
        spectrum: E on `starling.sim.scene.spectra.wavelength.GRID_NM` (1441,) [W m^-2 nm^-1].
        band: Spectral band of the imager.

    Raises:
        InputError: if the spectrum is not on the grid, or is negative or NaN anywhere.
    """
    if spectrum.shape != GRID_NM.shape or not (spectrum >= 0).all():
        raise errors.refuse(
            "spectrum",
            f"must be {GRID_NM.shape} numbers >= 0",
            f"{spectrum.shape}, least {spectrum.min() if spectrum.size else 'none'}",
            "Interpolate it to starling.sim.scene.spectra.wavelength.GRID_NM.",
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
    return in_band_irradiance(illuminants.irradiance(light, illuminance_lx), band)
