"""The imager: radiance at the lens to electrons to digital numbers (DN), after EMVA 1288.

Charge: crosstalk, pixel sensitivity, dark current, noise, offsets, full well. Converter: gain,
luminance of a mosaic, averaging, gamma, black level, quantisation.
"""

from __future__ import annotations

from starling.sim.arrays import Image
from starling.sim.imaging.imager import charge, converter, noise
from starling.sim.imaging.imager.charge import Die, Side
from starling.sim.imaging.imager.converter import Infrared as Infrared
from starling.sim.imaging.imager.converter import Readout as Readout
from starling.sim.imaging.imager.converter import quantise as quantise
from starling.sim.imaging.imager.converter import quantise_matched as quantise_matched
from starling.sim.imaging.imager.exposure import Exposure as Exposure
from starling.sim.imaging.imager.exposure import at_gain as at_gain
from starling.sim.imaging.imager.exposure import choose_exposure as choose_exposure
from starling.sim.imaging.imager.exposure import electrons_per_radiance as electrons_per_radiance
from starling.sim.imaging.imager.exposure import mean_electrons as mean_electrons
from starling.sim.imaging.imager.exposure import metered_rows_columns as metered_rows_columns
from starling.sim.imaging.imager.noise import DarkWindow as DarkWindow
from starling.sim.imaging.imager.noise import dark_window as dark_window
from starling.sim.imaging.imager.noise import noise_e as noise_e
from starling.sim.sensor.sensor import Imager


def read_out(
    part: Imager,
    electrons: Image,
    *,
    exposure_s: float,
    unit: int,
    side: Side,
    seed: int,
    frame: int,
) -> Readout:
    """Convert mean photoelectrons to DN, with all noise of the imager.

    Args:
        part: the imager's electronics.
        electrons: mean photoelectrons in each pixel's area (h, w).
        exposure_s: integration time, for the dark current [s].
        unit: number of the device; it selects the fixed patterns.
        side: which imager.
        seed: seed of the capture.
        frame: number of the frame in the capture.
    """
    die = Die(unit, side)
    held = charge.collect(part, electrons, exposure_s, die)
    held = noise.shot_and_read(part, held, die=die, seed=seed, frame=frame)
    held = noise.offsets(part, held, die=die, seed=seed, frame=frame)
    held = charge.fill_hot_pixels(part, held, die)
    return converter.convert(part, charge.limit_to_full_well(part, held))


def mix_pixels(part: Imager, light: Image) -> Image:
    """Apply crosstalk, luminance of a mosaic and averaging to light (h, w) in any unit."""
    return converter.mix(part, charge.crosstalk(light, part.crosstalk))
