"""Read-out: mean electrons to the image that a device gives."""

from __future__ import annotations

from starling.sim.imaging.imager import charge, converter, noise, well
from starling.sim.imaging.imager.converter import Readout
from starling.sim.imaging.imager.fixed_pattern import Die, Side
from starling.sim.render.layers import Image
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
    """Turn the electrons that light makes into DN.

    Args:
        part: the imager's electronics.
        electrons: mean number that light makes in each pixel's area (h, w).
        exposure_s: integration time, for the dark current [s].
        unit: number of the device: its fixed patterns.
        side: which of its imagers.
        seed: of the capture.
        frame: number in the capture.
    """
    die = Die(unit, side)
    held = charge.collected(part, electrons, exposure_s, die)
    held = noise.shot_and_read(part, held, die=die, seed=seed, frame=frame)
    held = noise.offsets(part, held, die=die, seed=seed, frame=frame)
    held = well.hot(part, held, die)
    return converter.converted(part, well.contained(part, held))
