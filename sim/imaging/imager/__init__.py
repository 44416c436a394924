"""The imager: radiance at the lens to electrons to digital numbers (DN), after EMVA 1288.

Charge: crosstalk, pixel sensitivity, dark current, noise, offsets, full well. Converter: gain,
averaging, gamma, black level, quantisation.
"""

from starling.sim.imaging.imager.converter import Infrared as Infrared
from starling.sim.imaging.imager.converter import Readout as Readout
from starling.sim.imaging.imager.converter import quantise as quantise
from starling.sim.imaging.imager.converter import quantise_matched as quantise_matched
from starling.sim.imaging.imager.exposure import Exposure as Exposure
from starling.sim.imaging.imager.exposure import choose_exposure as choose_exposure
from starling.sim.imaging.imager.exposure import electrons_per_radiance as electrons_per_radiance
from starling.sim.imaging.imager.exposure import mean_electrons as mean_electrons
from starling.sim.imaging.imager.mixing import mix_pixels as mix_pixels
from starling.sim.imaging.imager.noise import noise_e as noise_e
from starling.sim.imaging.imager.readout import read_out as read_out
