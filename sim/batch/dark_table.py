"""Windows without light at every gain that a sensor chooses."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

from starling.sim.imaging.imager import DarkWindow, dark_window
from starling.sim.sensor.sensor import Imager

PER_OCTAVE = 8  # Entries for each doubling of the gain.


@dataclass(frozen=True, slots=True)
class DarkTable:
    """What windows show without light, by gain."""

    own_gain: float  # Of the first entry; each of the others is 2^(1 / PER_OCTAVE) times larger.
    windows: tuple[DarkWindow, ...]


def dark_table(imager: Imager, bits: int) -> DarkTable:
    """Return what windows of an imager show without light, up to its highest gain.

    Args:
        imager: left imager.
        bits: of the codes, at most 10.
    """
    raised = bool(imager.auto_exposure_level) and imager.auto_exposure_max_gain > imager.gain
    ratio = imager.auto_exposure_max_gain / imager.gain if raised else 1.0
    steps = range(math.ceil(PER_OCTAVE * math.log2(ratio)) + 1)
    gains = [imager.gain * 2 ** (step / PER_OCTAVE) for step in steps]
    windows = [dark_window(dataclasses.replace(imager, gain=gain), bits) for gain in gains]
    return DarkTable(imager.gain, tuple(windows))
