"""Spectra: band-pass filter, silicon, lights, and the resulting electrons."""

from starling.sim.scene.spectra.band import Band as Band
from starling.sim.scene.spectra.band import ambient_w_m2 as ambient_w_m2
from starling.sim.scene.spectra.band import in_band_irradiance as in_band_irradiance
from starling.sim.scene.spectra.bandpass import ambient_transmission as ambient_transmission
from starling.sim.scene.spectra.bandpass import laser_transmission as laser_transmission
from starling.sim.scene.spectra.illuminants import names as names
