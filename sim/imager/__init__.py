"""The imager: radiance at the lens to electrons to digital numbers (DN), after EMVA 1288.

Charge: crosstalk, each pixel's sensitivity, dark current, noise, offsets, the full well. Then the
converter: gain, averaging, gamma, black level, whole codes.
"""

from sim.imager.converter import Infrared as Infrared
from sim.imager.converter import Readout as Readout
from sim.imager.converter import digital as digital
from sim.imager.converter import finest as finest
from sim.imager.exposure import Exposure as Exposure
from sim.imager.exposure import control as control
from sim.imager.exposure import electrons_per_radiance as electrons_per_radiance
from sim.imager.exposure import mean_electrons as mean_electrons
from sim.imager.mixing import mixed as mixed
from sim.imager.noise import noise_e as noise_e
from sim.imager.readout import read_out as read_out
