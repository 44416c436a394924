"""Binning of features: trees are trained on bin numbers and converted to values."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from starling.learning.methods.forest import Forest

BINS = 255  # Greatest number of bins of scikit-learn's histograms.


@dataclass(frozen=True, slots=True, eq=False)
class Bins:
    """Bins of all features."""

    # Upper ends, ascending; greater values are in the last bin.
    upper: tuple[NDArray[np.float32], ...]

    def numbers(self, values: NDArray[np.float32]) -> NDArray[np.uint8]:
        """Return the bin number of each value, (n, k)."""
        columns = [
            np.searchsorted(upper, column, side="left")
            for upper, column in zip(self.upper, values.T, strict=True)
        ]
        return np.stack(columns, axis=-1).astype(np.uint8)

    def in_units(self, forest: Forest) -> Forest:
        """Convert trees on bin numbers to trees on values."""
        threshold = forest.threshold.copy()
        for feature, upper in enumerate(self.upper):
            uses_feature = forest.feature == feature
            # A bin number of at most i means a value of at most the upper end of bin i.
            threshold[uses_feature] = upper[np.floor(threshold[uses_feature]).astype(int)]
        return dataclasses.replace(forest, threshold=threshold)


def equal_count_bins(values: NDArray[np.float32]) -> Bins:
    """Divide each feature into at most 255 bins with equally many values.

    scikit-learn bins by weight: rare pixels drawn at a higher rate would share a few bins, and its
    weighted quantiles take longer than the trees.

    Args:
        values: (n, k) finite.
    """
    ranks = np.linspace(0, 1, BINS + 1)[1:-1]
    quantiles = np.quantile(values, ranks, axis=0, method="inverted_cdf").astype(np.float32)
    return Bins(tuple(np.unique(column) for column in quantiles.T))
