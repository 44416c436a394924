"""Features sorted into bins: trees are grown on the numbers of the bins, then read in units."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from starling.learning.methods.forest import Forest

BINS = 255  # The most that scikit-learn's histograms hold.


@dataclass(frozen=True, slots=True, eq=False)
class Bins:
    """Bins of every feature."""

    upper: tuple[NDArray[np.float32], ...]  # Upper ends, ascending; what is above is the last bin.

    def numbers(self, values: NDArray[np.float32]) -> NDArray[np.uint8]:
        """Number of the bin that each value falls in, (n, k)."""
        columns = [
            np.searchsorted(upper, column, side="left")
            for upper, column in zip(self.upper, values.T, strict=True)
        ]
        return np.stack(columns, axis=-1).astype(np.uint8)

    def in_units(self, forest: Forest) -> Forest:
        """Turn trees that ask for numbers of bins into trees that ask for the values."""
        threshold = forest.threshold.copy()
        for feature, upper in enumerate(self.upper):
            here = forest.feature == feature
            # At most number i means at most the upper end of bin i.
            threshold[here] = upper[np.floor(threshold[here]).astype(int)]
        return dataclasses.replace(forest, threshold=threshold)


def equal_count_bins(values: NDArray[np.float32]) -> Bins:
    """Cut each feature into at most 255 bins with equally many of the values.

    Not left to scikit-learn, which cuts by weight: rare pixels drawn in plenty would share a few
    bins, and the search for its weighted quantiles takes longer than the trees.

    Args:
        values: (n, k) finite.
    """
    ranks = np.linspace(0, 1, BINS + 1)[1:-1]
    quantiles = np.quantile(values, ranks, axis=0, method="inverted_cdf").astype(np.float32)
    return Bins(tuple(np.unique(column) for column in quantiles.T))
