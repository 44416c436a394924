"""Wavelengths: laser line, band-pass filter, silicon and lights, and what they sum up to."""

from sim.spectra.band import Band as Band
from sim.spectra.band import ambient_w_m2 as ambient_w_m2
from sim.spectra.band import in_band_irradiance as in_band_irradiance
from sim.spectra.band import wall_electrons as wall_electrons
from sim.spectra.bandpass import ambient_transmission as ambient_transmission
from sim.spectra.bandpass import laser_transmission as laser_transmission
from sim.spectra.illuminants import names as names
from sim.spectra.laser import Laser as Laser
