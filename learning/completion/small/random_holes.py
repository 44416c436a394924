"""Holes that know nothing of light or geometry, as completion is commonly trained on.

The control that shows what simulated holes are worth: the camera's own noise stays where it has
depth, its holes are closed with the truth, which has none, and as large a share is taken out again
by lot, half as rectangles and half pixel by pixel.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from starling.learning.completion.small.crops import Sample
from starling.sim.randomness import generator

_SIDES = (0.02, 0.25)  # Of rectangles, over the image's.
_SINGLE = 0.5  # Share of the pixels taken out that is by lot, pixel by pixel.


def with_random_holes(sample: Sample, seed: int, number: int) -> Sample:
    """Put random holes where a sample's own were.

    Args:
        sample: whose truth is known wherever its camera has no depth, or the holes there stay.
        seed: of the draw.
        number: the sample's, so that no two have the same.
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
        out.flat[np.flatnonzero(block & ~out)[:missing]] = True  # The last one is cut to size.
    depth_m = np.where(out, np.float32(np.nan), closed).astype(np.float32)
    return dataclasses.replace(sample, depth_m=depth_m)
