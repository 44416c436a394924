"""Statistics of small blocks of an image; the blocks with the least variance show mainly noise."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from starling.calibration.least_squares import variable_projection

BLOCK_PX = 8
QUIETEST = 0.1  # Quantile of the blocks' variance.
INDEPENDENT = 0.25  # Share of independent pixels in a block, after the device's averaging.


def blocks(image: NDArray) -> NDArray:
    """Return the pixels of each block (n, 64); incomplete blocks are dropped."""
    return variable_projection.cut(image, BLOCK_PX)


def quietest_by_chance(pixels: float) -> float:
    """Return the 10 % quantile of the variance of blocks of pure noise, over its mean.

    Args:
        pixels: number of noisy pixels in a block, including correlated neighbours.
    """
    freedom = max(INDEPENDENT * pixels - 1, 1.0)
    return float(stats.chi2.ppf(QUIETEST, freedom)) / freedom


def quietest(variance: NDArray) -> float:
    """Return the 10 % quantile of the blocks' variance (n,)."""
    return float(np.quantile(variance, QUIETEST))
