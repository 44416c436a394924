"""Fixed-pattern variation of a device's pixels, the same in every capture."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np

from starling.sim import randomness
from starling.sim.arrays import Image

Side = Literal["left", "right"]


@dataclass(frozen=True, slots=True)
class Die:
    """One imager of one device; it identifies the fixed patterns."""

    unit: int  # Number of the device, `Sensor.unit`.
    side: Side

    def normal(self, effect: str, shape: tuple[int, ...]) -> Image:
        """Return standard normal deviates of the pixels (h, w), or of the columns (w,).

        Another image size has an independent pattern: it models a readout mode, not a crop.
        """
        return _drawn(self, effect, shape, "normal")

    def uniform(self, effect: str, shape: tuple[int, ...]) -> Image:
        """Return uniform deviates in [0, 1) of the pixels (h, w)."""
        return _drawn(self, effect, shape, "uniform")


@lru_cache(maxsize=12)  # Three patterns, two imagers, two image sizes.
def _drawn(die: Die, effect: str, shape: tuple[int, ...], law: Literal["normal", "uniform"]):
    rng = randomness.generator(die.unit, 0, "imager", f"fixed {effect} {die.side}")
    draw = rng.standard_normal if law == "normal" else rng.random
    pattern = draw(shape, np.float32)
    pattern.setflags(write=False)  # All captures share the array.
    return pattern
