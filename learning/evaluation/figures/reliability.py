"""Calibration of probabilities: of the pixels with predicted 0.3, do 30 % have no depth?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from starling.learning.evaluation.figures.judged import Judged
from starling.patterns import errors

BINS = 15


@dataclass(frozen=True, slots=True, eq=False)
class Reliability:
    """Predicted and observed shares in bins of equally many pixels, by ascending probability."""

    predicted: NDArray[np.float64]  # (bins,) mean probability.
    observed: NDArray[np.float64]  # (bins,) share without depth.
    pixels: NDArray[np.int64]  # (bins,)

    @property
    def expected_calibration_error(self) -> float:
        """Mean absolute difference of predicted and observed (ECE), weighted by pixels."""
        gap = np.abs(self.predicted - self.observed)
        return float(np.average(gap, weights=self.pixels))


def reliability(judged: Judged, bins: int = BINS) -> Reliability:
    """Sort pixels into bins of equal count. Pixels of one probability stay in one bin.

    The curve thus does not depend on the order of pixels, and there are fewer bins where many
    pixels share a probability. Bins of equal width would hold almost all pixels of a depth image in
    one bin, because most probabilities are nearly 0.

    Source: Nguyen and O'Connor, Posterior calibration and exploratory analysis for natural language
    processing models, EMNLP 2015, sec. 3.

    Raises:
        InputError: if `bins` is not in [1, 10000].
    """
    errors.in_interval("bins", bins, 1, 10_000)
    order = np.argsort(judged.probability, kind="stable")
    probability, ndp = judged.probability[order], judged.ndp[order]
    wanted = np.arange(1, bins + 1) * probability.size // bins
    wanted = wanted[wanted > 0]
    ends = np.unique(np.searchsorted(probability, probability[wanted - 1], side="right"))
    starts = np.append(0, ends[:-1])
    pixels = ends - starts
    return Reliability(
        predicted=np.add.reduceat(probability, starts) / pixels,
        observed=np.add.reduceat(ndp.astype(np.float64), starts) / pixels,
        pixels=pixels,
    )
