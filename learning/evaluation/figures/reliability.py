"""Whether probabilities mean what they say: of the pixels told 0.3, do 30 % have no depth?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from starling.learning.evaluation.figures.judged import Judged
from starling.patterns import errors

BINS = 15


@dataclass(frozen=True, slots=True, eq=False)
class Reliability:
    """Told against observed, in bins of equally many pixels, by ascending probability."""

    told: NDArray[np.float64]  # (bins,) mean probability.
    observed: NDArray[np.float64]  # (bins,) share without depth.
    pixels: NDArray[np.int64]  # (bins,)

    @property
    def expected_calibration_error(self) -> float:
        """Mean absolute difference of told and observed (ECE), weighted by pixels; 0 is best."""
        gap = np.abs(self.told - self.observed)
        return float(np.average(gap, weights=self.pixels))


def reliability(judged: Judged, bins: int = BINS) -> Reliability:
    """Sort pixels into bins of equal count; those of one probability stay in one bin.

    So the curve does not depend on the order of pixels, and fewer bins come back where many pixels
    share a probability. Equal counts, as most pixels of a depth image are told nearly 0, where bins
    of equal width would put almost all in one.

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
        told=np.add.reduceat(probability, starts) / pixels,
        observed=np.add.reduceat(ndp.astype(np.float64), starts) / pixels,
        pixels=pixels,
    )
