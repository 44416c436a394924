"""Small squares of an image: where something varies least, little but noise is left."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from starling.calibration.least_squares import variable_projection

BLOCK_PX = 8
QUIETEST = 0.1  # Share of the blocks that vary least.
INDEPENDENT = 0.25  # Share of a block's pixels that are so, after averaging.


def blocks(image: NDArray) -> NDArray:
    """Pixels of each block (n, 64); what does not fill one is left out."""
    return variable_projection.cut(image, BLOCK_PX)


def quietest_by_chance(pixels: float) -> float:
    """Variance over its mean that the quietest tenth of blocks of pure noise has at most.

    Args:
        pixels: of a block that carry the noise, neighbours counted.
    """
    freedom = max(INDEPENDENT * pixels - 1, 1.0)
    return float(stats.chi2.ppf(QUIETEST, freedom)) / freedom


def quietest(variance: NDArray) -> float:
    """Variance that a tenth of the blocks (n,) stays below."""
    return float(np.quantile(variance, QUIETEST))
