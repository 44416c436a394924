"""Receiver operating characteristic: how well probabilities rank pixels with and without depth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from starling.learning.evaluation.figures.judged import Judged
from starling.patterns import errors


@dataclass(frozen=True, slots=True, eq=False)
class Roc:
    """Corners of the curve, from (0, 0) to (1, 1); straight between them."""

    false_positive_rate: NDArray[np.float64]  # (k,) ascending.
    true_positive_rate: NDArray[np.float64]  # (k,) ascending.
    threshold: NDArray[np.float64]  # (k,) descending: marked are the pixels at or above it.

    @property
    def area(self) -> float:
        """Area under the curve (AUC), 0.5 by chance, ties counted half."""
        return float(np.trapezoid(self.true_positive_rate, self.false_positive_rate))

    def true_positive_rate_at(self, false_positive_rate: float) -> float:
        """Highest true-positive rate at a false-positive rate, both 0 to 1.

        Between two corners lies what drawing among the tied pixels reaches in the mean.

        Raises:
            InputError: if the rate is outside [0, 1].
        """
        errors.in_interval("false_positive_rate", false_positive_rate, 0.0, 1.0)
        across, up = self.false_positive_rate, self.true_positive_rate
        # Not np.interp: where the curve rises straight up it would start from the wrong end.
        last = int(np.searchsorted(across, false_positive_rate, side="right")) - 1
        if last == len(across) - 1:
            return float(up[last])
        part = (false_positive_rate - across[last]) / (across[last + 1] - across[last])
        return float(up[last] + part * (up[last + 1] - up[last]))


def roc(judged: Judged) -> Roc:
    """Build the curve: one corner for every distinct probability, so that ties have no order.

    Source: Fawcett, An introduction to ROC analysis, Pattern Recognition Letters 27, 2006.

    Raises:
        InputError: if all pixels have depth, or none has.
    """
    positives = int(np.count_nonzero(judged.ndp))
    negatives = judged.ndp.size - positives
    if not positives or not negatives:
        raise errors.refuse(
            "no-depth pixels",
            "must be some and not all of the counted ones",
            f"{positives} of {judged.ndp.size}",
            "A curve needs both kinds: take more scenes.",
        )
    order = np.argsort(-judged.probability)
    probability, ndp = judged.probability[order], judged.ndp[order]
    ends = np.append(np.flatnonzero(np.diff(probability)), probability.size - 1)
    found = np.cumsum(ndp)[ends]
    return Roc(
        false_positive_rate=np.append(0.0, (ends + 1 - found) / negatives),
        true_positive_rate=np.append(0.0, found / positives),
        threshold=np.append(np.inf, probability[ends]),
    )
