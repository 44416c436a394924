"""Boosted regression trees as plain arrays, evaluated, saved and loaded without scikit-learn."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numba as nb
import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from sklearn.ensemble import HistGradientBoostingClassifier


_BLOCK = 512  # Pixels that are evaluated tree by tree, so that both stay in the cache.


@dataclass(frozen=True, slots=True, eq=False)
class Forest:
    """Nodes of all trees, tree after tree. Children are indices into these arrays."""

    feature: NDArray[np.int32]  # (n,) number of the feature; -1 = a leaf.
    threshold: NDArray[np.float64]  # (n,) values up to this go left.
    left: NDArray[np.int32]  # (n,)
    right: NDArray[np.int32]  # (n,)
    value: NDArray[np.float64]  # (n,) contribution of a leaf to the logit.
    root: NDArray[np.int32]  # (trees,) index of each tree's first node.
    start: float  # Logit before the first tree.

    def logit(self, values: NDArray[np.float32]) -> NDArray[np.float64]:
        """Sum the leaves of all trees.

        Args:
            values: (n, k) finite features.

        Returns:
            (n,) logit of the probability.
        """
        total = np.full(len(values), self.start)
        nodes = self.feature, self.threshold, self.left, self.right, self.value
        _add(np.ascontiguousarray(values), *nodes, self.root, total)
        return total

    def first(self, trees: int) -> Forest:
        """Return the forest of the first trees only."""
        return dataclasses.replace(self, root=self.root[:trees])

    def is_sound(self, features: int) -> bool:
        """Return whether all nodes lead to a leaf and use valid features.

        A file can hold anything, and the compiled code does not check indices.
        """
        nodes = self.feature, self.threshold, self.left, self.right, self.value
        if any(array.shape != (self.feature.size,) for array in nodes) or self.root.ndim != 1:
            return False
        numbers = np.arange(self.feature.size)
        inner = self.feature >= 0
        children = np.stack([self.left, self.right])[:, inner]
        return bool(
            np.all(self.feature < features)
            # Children follow their parent, so that there are no cycles.
            and np.all((children > numbers[inner]) & (children < numbers.size))
            and np.all((self.root >= 0) & (self.root < numbers.size))
            and np.isfinite([*self.threshold, *self.value, self.start]).all()
        )


def forest_of(model: HistGradientBoostingClassifier) -> Forest:
    """Extract the trees of a fitted two-class model of numeric features.

    scikit-learn has no public interface for them; a test compares the predictions.
    """
    trees = [step[0].nodes for step in model._predictors]
    root = np.cumsum([0, *(len(tree) for tree in trees)])[:-1].astype(np.int32)
    nodes = np.concatenate(trees)
    offset = np.repeat(root, [len(tree) for tree in trees])
    leaf = nodes["is_leaf"].astype(bool)
    return Forest(
        feature=np.where(leaf, -1, nodes["feature_idx"]).astype(np.int32),
        threshold=np.where(leaf, 0.0, nodes["num_threshold"]),
        left=np.where(leaf, 0, nodes["left"] + offset).astype(np.int32),
        right=np.where(leaf, 0, nodes["right"] + offset).astype(np.int32),
        value=np.where(leaf, nodes["value"], 0.0),
        root=root,
        start=float(np.ravel(model._baseline_prediction)[0]),
    )


@nb.njit(nogil=True, cache=True)
def _add(  # pragma: no cover - compiled
    values: NDArray[np.float32],
    feature: NDArray[np.int32],
    threshold: NDArray[np.float64],
    left: NDArray[np.int32],
    right: NDArray[np.int32],
    value: NDArray[np.float64],
    root: NDArray[np.int32],
    total: NDArray[np.float64],
) -> None:
    pixels = values.shape[0]
    for first in range(0, pixels, _BLOCK):
        for tree in range(root.size):
            for pixel in range(first, min(first + _BLOCK, pixels)):
                node = root[tree]
                while feature[node] >= 0:
                    if values[pixel, feature[node]] <= threshold[node]:
                        node = left[node]
                    else:
                        node = right[node]
                total[pixel] += value[node]


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
