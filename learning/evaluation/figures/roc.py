"""Receiver operating characteristic: ranking of pixels with and without depth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from starling.learning.evaluation.figures.judged import Judged
from starling.patterns import errors


@dataclass(frozen=True, slots=True, eq=False)
class Roc:
    """Corners of the curve, from (0, 0) to (1, 1), connected by straight lines."""

    false_positive_rate: NDArray[np.float64]  # (k,) ascending.
    true_positive_rate: NDArray[np.float64]  # (k,) ascending.
    threshold: NDArray[np.float64]  # (k,) descending; pixels at or above it are positive.

    @property
    def area(self) -> float:
        """Area under the curve (AUC), 0.5 by chance, ties counted half."""
        return float(np.trapezoid(self.true_positive_rate, self.false_positive_rate))

    def true_positive_rate_at(self, false_positive_rate: float) -> float:
        """True-positive rate at a false-positive rate, both 0 to 1; the highest one if not unique.

        Values between two corners are the expectation of a random choice among tied pixels.

        Raises:
            InputError: if the rate is outside [0, 1].
        """
        errors.in_interval("false_positive_rate", false_positive_rate, 0.0, 1.0)
        across, up = self.false_positive_rate, self.true_positive_rate
        # np.interp would use the lower end of vertical segments.
        last = int(np.searchsorted(across, false_positive_rate, side="right")) - 1
        if last == len(across) - 1:
            return float(up[last])
        part = (false_positive_rate - across[last]) / (across[last + 1] - across[last])
        return float(up[last] + part * (up[last + 1] - up[last]))


def roc(judged: Judged) -> Roc:
    """Compute the curve, with one corner for each distinct probability.

    Source: Fawcett, An introduction to ROC analysis, Pattern Recognition Letters 27, 2006.

    Raises:
        InputError: if all or none of the pixels have depth.
    """
    positives = int(np.count_nonzero(judged.ndp))
    negatives = judged.ndp.size - positives
    if not positives or not negatives:
        raise errors.refuse(
            "no-depth pixels",
            "must be some and not all of the counted ones",
            f"{positives} of {judged.ndp.size}",
            "A curve needs both kinds; use more scenes.",
        )
    order = np.argsort(-judged.probability)
    probability, ndp = judged.probability[order], judged.ndp[order]
    ends = np.append(np.flatnonzero(np.diff(probability)), probability.size - 1)
    true_positives = np.cumsum(ndp)[ends]
    return Roc(
        false_positive_rate=np.append(0.0, (ends + 1 - true_positives) / negatives),
        true_positive_rate=np.append(0.0, true_positives / positives),
        threshold=np.append(np.inf, probability[ends]),
    )
