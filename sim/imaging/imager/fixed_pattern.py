"""Fixed patterns: what a device's pixels have by birth, the same in every capture."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np

from starling.sim import randomness
from starling.sim.render.layers import Image

Side = Literal["left", "right"]


@dataclass(frozen=True, slots=True)
class Die:
    """One imager of one device: whose pixels these are."""

    unit: int  # Number of the device, `Sensor.unit`.
    side: Side

    def normal(self, effect: str, shape: tuple[int, ...]) -> Image:
        """Standard normal deviates of the pixels (h, w), or of the columns (w,).

        Another image size is drawn anew: it stands for another readout mode, not for a crop.
        """
        return _drawn(self, effect, shape, "normal")

    def uniform(self, effect: str, shape: tuple[int, ...]) -> Image:
        """Uniform deviates in [0, 1) of the pixels (h, w)."""
        return _drawn(self, effect, shape, "uniform")


@lru_cache(maxsize=12)  # Three patterns of either side for two image sizes.
def _drawn(die: Die, effect: str, shape: tuple[int, ...], law: Literal["normal", "uniform"]):
    rng = randomness.generator(die.unit, 0, "imager", f"fixed {effect} {die.side}")
    draw = rng.standard_normal if law == "normal" else rng.random
    pattern = draw(shape, np.float32)
    pattern.setflags(write=False)  # It is shared by all captures.
    return pattern
