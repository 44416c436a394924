"""Boosted regression trees as plain arrays: evaluated, stored and read without their library."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numba as nb
import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from sklearn.ensemble import HistGradientBoostingClassifier

_BLOCK = 512  # Pixels that pass one tree after the other while both stay in the cache.


@dataclass(frozen=True, slots=True, eq=False)
class Forest:
    """All nodes, tree after tree; children are found by their index in these arrays."""

    feature: NDArray[np.int32]  # (n,) which is asked; -1 = a leaf.
    threshold: NDArray[np.float64]  # (n,) at most this goes left.
    left: NDArray[np.int32]  # (n,)
    right: NDArray[np.int32]  # (n,)
    value: NDArray[np.float64]  # (n,) what a leaf adds to the logit.
    root: NDArray[np.int32]  # (trees,) where each tree begins.
    start: float  # Logit before any tree.

    def logit(self, values: NDArray[np.float32]) -> NDArray[np.float64]:
        """Sum the trees' answers.

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
        """Only the first trees, as boosting left it then."""
        return dataclasses.replace(self, root=self.root[:trees])

    def is_sound(self, features: int) -> bool:
        """Whether all nodes lead on to a leaf and ask for one of so many features.

        A file may hold anything, and the compiled code looks up what it is told to.
        """
        nodes = self.feature, self.threshold, self.left, self.right, self.value
        if any(array.shape != (self.feature.size,) for array in nodes) or self.root.ndim != 1:
            return False
        own = np.arange(self.feature.size)
        inner = self.feature >= 0
        children = np.stack([self.left, self.right])[:, inner]
        return bool(
            np.all(self.feature < features)
            # Children come after their parent, so no way goes round in circles.
            and np.all((children > own[inner]) & (children < own.size))
            and np.all((self.root >= 0) & (self.root < own.size))
            and np.isfinite([*self.threshold, *self.value, self.start]).all()
        )


def forest_of(model: HistGradientBoostingClassifier) -> Forest:
    """Take the trees out of a fitted two-class model of numeric features.

    scikit-learn offers no public way to them; a test holds that both answer alike.
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
