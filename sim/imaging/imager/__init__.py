"""The imager: radiance at the lens to electrons to digital numbers (DN), after EMVA 1288.

Charge: crosstalk, each pixel's sensitivity, dark current, noise, offsets, the full well. Then the
converter: gain, averaging, gamma, black level, whole codes.
"""

from starling.sim.imaging.imager.converter import Infrared as Infrared
from starling.sim.imaging.imager.converter import Readout as Readout
from starling.sim.imaging.imager.converter import digital as digital
from starling.sim.imaging.imager.converter import finest as finest
from starling.sim.imaging.imager.exposure import Exposure as Exposure
from starling.sim.imaging.imager.exposure import control as control
from starling.sim.imaging.imager.exposure import electrons_per_radiance as electrons_per_radiance
from starling.sim.imaging.imager.exposure import mean_electrons as mean_electrons
from starling.sim.imaging.imager.mixing import mixed as mixed
from starling.sim.imaging.imager.noise import noise_e as noise_e
from starling.sim.imaging.imager.readout import read_out as read_out
