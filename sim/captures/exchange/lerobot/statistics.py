"""Statistics of a LeRobot data set: smallest, largest, mean, spread and quantiles of each feature.

LeRobot estimates them from a sample of the pixels. Here they are of all pixels, by histograms.

Source: LeRobot 0.6.1, `datasets/compute_stats.py`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

QUANTILES = (0.01, 0.1, 0.5, 0.9, 0.99)
_LEVELS = 2**16  # Of images with 16 bits.
Statistics = Mapping[str, Any]


class Histogram:
    """Counts of the levels of one image stream, by channel."""

    def __init__(self, channels: int, value_of_level: float) -> None:
        self._counts = np.zeros((channels, _LEVELS), np.int64)
        self._step = value_of_level
        self._images = 0

    def add(self, levels: NDArray[np.uint16]) -> None:
        """Count an image (h, w, channels)."""
        for channel, counts in enumerate(self._counts):
            counts += np.bincount(levels[..., channel].ravel(), minlength=_LEVELS)
        self._images += 1

    def merge(self, part: Histogram) -> None:
        """Add the counts of another histogram of the same stream."""
        self._counts += part._counts
        self._images += part._images

    def statistics(self) -> Statistics:
        """Return the statistics, each of shape (channels, 1, 1)."""
        values = np.arange(_LEVELS) * self._step
        total = self._counts.sum(axis=1)
        mean = self._counts @ values / total
        square = self._counts @ values**2 / total
        spread = np.sqrt(np.maximum(square - mean**2, 0))
        figures = {
            "min": [values[np.flatnonzero(row)[0]] for row in self._counts],
            "max": [values[np.flatnonzero(row)[-1]] for row in self._counts],
            "mean": mean,
            "std": spread,
        }
        below = np.cumsum(self._counts, axis=1)
        for share in QUANTILES:
            places = [np.searchsorted(row, share * row[-1]) for row in below]
            figures[_name(share)] = values[places]
        shaped = {
            name: [[[float(value)]] for value in channels] for name, channels in figures.items()
        }
        return {**shaped, "count": [self._images]}


def of_numbers(values: Sequence[float]) -> Statistics:
    """Return the statistics of a number for each frame, each of shape (1,)."""
    numbers = np.asarray(values, np.float64)
    figures = {
        "min": numbers.min(),
        "max": numbers.max(),
        "mean": numbers.mean(),
        "std": numbers.std(),
        **{_name(share): np.quantile(numbers, share) for share in QUANTILES},
    }
    return {**{name: [float(value)] for name, value in figures.items()}, "count": [len(numbers)]}


def _name(share: float) -> str:
    return f"q{round(100 * share):02d}"
