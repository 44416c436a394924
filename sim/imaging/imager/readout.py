"""Read-out: mean electrons to the digital images."""

from __future__ import annotations

from starling.sim.arrays import Image
from starling.sim.imaging.imager import charge, converter, noise, well
from starling.sim.imaging.imager.converter import Readout
from starling.sim.imaging.imager.fixed_pattern import Die, Side
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
    held = well.fill_hot_pixels(part, held, die)
    return converter.convert(part, well.limit_to_full_well(part, held))
