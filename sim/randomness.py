"""Independent random streams per effect, derived from one seed per capture.

Adding an effect does not change the random numbers of the others.
"""

from __future__ import annotations

import zlib

import numpy as np


def generator(seed: int, frame: int, stage: str, effect: str) -> np.random.Generator:
    """Return the generator of one effect in one frame; equal arguments give equal numbers."""
    words = [seed, frame, zlib.crc32(stage.encode()), zlib.crc32(effect.encode())]
    return np.random.Generator(np.random.SFC64(np.random.SeedSequence(words)))
