"""Random holes that depend on neither light nor geometry, the usual training data of completion.

This is the control that measures the value of simulated holes. The camera's noise stays where it
has depth. Its holes are filled with the noise-free truth, and an equal share of pixels is removed
at random. Half of it is removed as rectangles and half as single pixels.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from starling.learning.completion.small.crops import FrameSample
from starling.sim.randomness import generator

_SIDES = (0.02, 0.25)  # Range of the rectangles' sides, relative to the image's.
_SINGLE = 0.5  # Share of the removed pixels that are single pixels.


def with_random_holes(sample: FrameSample, seed: int, number: int) -> FrameSample:
    """Replace a sample's holes by random ones.

    Args:
        sample: sample with known truth; holes with unknown truth remain.
        seed: random seed.
        number: number of the sample, so that samples differ.
    """
    rng = generator(seed, number, "completion", "random holes")
    share = float(np.isnan(sample.depth_m).mean())
    closed = np.where(np.isnan(sample.depth_m), sample.truth_m, sample.depth_m)
    height, width = closed.shape
    out = rng.random(closed.shape) < _SINGLE * share
    wanted = share * closed.size
    while (missing := int(wanted) - np.count_nonzero(out)) > 0:
        rows = int(height * rng.uniform(*_SIDES)) + 1
        columns = int(width * rng.uniform(*_SIDES)) + 1
        top = int(rng.integers(height - rows + 1))
        left = int(rng.integers(width - columns + 1))
        block = np.zeros_like(out)
        block[top : top + rows, left : left + columns] = True
        out.flat[np.flatnonzero(block & ~out)[:missing]] = True  # The last block is cut to size.
    depth_m = np.where(out, np.float32(np.nan), closed).astype(np.float32)
    return dataclasses.replace(sample, depth_m=depth_m)
