"""One score: the mean or median of a value over cases, with a 95 % interval."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from starling.diagnosis.validation.protocol.verdict import CaseResult

_DRAWS = 20000  # Number of bootstrap samples.
_TAIL = 0.025  # Probability of each tail.


@dataclass(frozen=True, kw_only=True, slots=True)
class ScoreStatistic:
    """The values of a score, case by case."""

    values: tuple[float, ...]
    set_numbers: tuple[int, ...]  # Number of the scene set of each value.
    median: bool = False  # Whether the score is the median; else it is the mean.
    share: bool = False  # Whether the values are 1 for correct and 0 for wrong cases.

    @property
    def value(self) -> float | None:
        """The score, or None without a value."""
        if not self.values:
            return None
        if self.median:
            return float(np.median(self.values))
        return math.fsum(self.values) / len(self.values)

    def interval(self, sets: Sequence[int]) -> tuple[float, float] | None:
        """Return the 95 % cluster bootstrap interval. Scene sets are resampled, not single cases.

        Percentile intervals of n sets are too narrow by sqrt((n - 1) / n) and by the ratio of
        Student's t to the normal law. The expanded percentile interval corrects both (Hesterberg,
        What teachers should know about the bootstrap, Am. Stat. 69, 2015). The bootstrap of few
        unanimous cases has no width. The interval of a share therefore contains the exact interval
        of independent cases (Clopper and Pearson, Biometrika 26, 1934).

        Args:
            sets: Numbers of all scene sets, without duplicates.

        Returns:
            Lower and upper end, or None without a value or with fewer than two sets.
        """
        if not self.values or len(sets) < 2:
            return None
        rng = np.random.Generator(np.random.SFC64(0))
        times = rng.multinomial(len(sets), np.full(len(sets), 1 / len(sets)), size=_DRAWS)
        place = {number: i for i, number in enumerate(sorted(sets))}
        weights = times[:, [place[number] for number in self.set_numbers]]
        nonempty = weights[weights.any(axis=1)]
        scores = self._medians(nonempty) if self.median else self._means(nonempty)
        count = len(sets)
        expanded = np.sqrt(count / (count - 1)) * stats.t.isf(_TAIL, count - 1)
        tail = float(stats.norm.sf(expanded))
        ends = (tail, 1 - tail)
        low, high = np.quantile(scores, ends, method="nearest")  # Errors may be infinite.
        least, most = self._exact()
        return min(float(low), least), max(float(high), most)

    def _exact(self) -> tuple[float, float]:
        """Exact interval of a share of independent cases; empty if the score is no share."""
        if not self.share:
            return math.inf, -math.inf
        correct = int(sum(self.values))
        ends = stats.binomtest(correct, len(self.values)).proportion_ci(1 - 2 * _TAIL)
        return float(ends.low), float(ends.high)

    def _means(self, weights: NDArray[np.int64]) -> NDArray[np.float64]:
        return weights @ np.array(self.values) / weights.sum(axis=1)

    def _medians(self, weights: NDArray[np.int64]) -> NDArray[np.float64]:
        order = np.argsort(self.values)
        below = np.cumsum(weights[:, order], axis=1)
        count = below[:, -1:]
        middle = [np.argmax(below > rank, axis=1) for rank in ((count - 1) // 2, count // 2)]
        return np.array(self.values)[order][middle].mean(axis=0)


def statistic(
    results: Iterable[CaseResult],
    value_of: Callable[[CaseResult], float | None],
    *,
    median: bool = False,
) -> ScoreStatistic:
    """Collect the values of a score over cases.

    Args:
        results: Cases with their verdicts.
        value_of: Returns the value of a case, or None if it has none. Booleans make a share.
        median: Use the median in place of the mean.
    """
    values = [
        (value, result.set_number) for result in results if (value := value_of(result)) is not None
    ]
    return ScoreStatistic(
        values=tuple(float(value) for value, _ in values),
        set_numbers=tuple(number for _, number in values),
        median=median,
        share=all(isinstance(value, bool) for value, _ in values),
    )
