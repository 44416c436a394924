"""The laser's line and its drift with temperature."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from starling.patterns import errors
from starling.sim.scene.spectra import wavelength
from starling.sim.scene.spectra.wavelength import Spectrum

_FWHM_PER_SIGMA = float(2 * np.sqrt(2 * np.log(2)))


@dataclass(frozen=True, kw_only=True, slots=True)
class Laser:
    """A laser's line: a Gaussian whose centre drifts linearly with temperature."""

    centre_nm: float = 850.0  # Centre at the reference temperature.
    width_nm: float = 1.0  # Full width at half maximum of all emitters together.
    drift_nm_k: float = 0.07  # Drift of the centre [nm / K].
    reference_c: float = 20.0  # Temperature at which `centre_nm` holds [deg C].

    def __post_init__(self) -> None:
        wavelength.in_silicon("laser.centre_nm", self.centre_nm)
        errors.in_interval("laser.width_nm", self.width_nm, 0.01, 50.0, "Give nanometres.")
        errors.in_interval("laser.drift_nm_k", self.drift_nm_k, -1.0, 1.0, "Give nm per kelvin.")
        errors.in_interval("laser.reference_c", self.reference_c, -100.0, 200.0)

    def line_nm(self, temperature_c: float) -> float:
        """Centre of the line at a temperature [nm].

        Raises:
            InputError: if the temperature is outside -100 to 200 deg C.
        """
        errors.in_interval("temperature_c", temperature_c, -100.0, 200.0, "Give degrees Celsius.")
        return self.centre_nm + self.drift_nm_k * (temperature_c - self.reference_c)

    def spectrum(self, temperature_c: float, wavelength_nm: Spectrum) -> Spectrum:
        """Spectral distribution of the power [1 / nm], of integral 1."""
        sigma = self.width_nm / _FWHM_PER_SIGMA
        off = (wavelength_nm - self.line_nm(temperature_c)) / sigma
        return np.exp(-0.5 * off**2) / (sigma * np.sqrt(2 * np.pi))


# D4xx: 850 +-10 nm at 20 deg C (FRAMOS D435e manual, p. 8). A drift of 0.06 to 0.07 nm / K is
# typical of vertical-cavity lasers at this wavelength (assumed, no datasheet). The line's width is
# assumed.
D4XX = Laser()
# Kinect v1: an 830 nm edge emitter with a Peltier element that holds its temperature
# (openkinect.org, Hardware info). A drift of 0.3 nm / K is typical of edge emitters (assumed).
KINECT = Laser(centre_nm=830.0, drift_nm_k=0.3)
