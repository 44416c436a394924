"""One score: mean or median over cases, and how sure it is."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from starling.diagnosis.validation.protocol.answered import Answered

_DRAWS = 20000
_TAIL = 0.025


@dataclass(frozen=True, kw_only=True, slots=True)
class Figure:
    """What a score is made of, case by case."""

    values: tuple[float, ...]
    scenes: tuple[int, ...]  # Of each value, the number of its set of scenes.
    median: bool = False  # Else the mean.
    share: bool = False  # Whether values are 1 of cases that are right and 0 of others.

    @property
    def value(self) -> float | None:
        """The score; None where no case tells."""
        if not self.values:
            return None
        if self.median:
            return float(np.median(self.values))
        return math.fsum(self.values) / len(self.values)

    def interval(self, sets: Sequence[int]) -> tuple[float, float] | None:
        """95 % of what sets of scenes drawn anew would give: cases of one set are alike.

        Percentiles of means of n sets are too narrow by sqrt((n - 1) / n) and by what Student's t
        has beyond the normal law, so those farther out are taken. (Hesterberg, What teachers should
        know about the bootstrap, Am. Stat. 69, 2015: expanded percentile interval.) A share has at
        least the interval of as many cases that are not alike (Clopper and Pearson, Biometrika 26,
        1934), as few cases that all agree would else be sure of anything.

        Args:
            sets: Numbers of all sets of scenes, no number twice.

        Returns:
            None where no case tells, or of one set alone.
        """
        if not self.values or len(sets) < 2:
            return None
        rng = np.random.Generator(np.random.SFC64(0))
        times = rng.multinomial(len(sets), np.full(len(sets), 1 / len(sets)), size=_DRAWS)
        place = {number: i for i, number in enumerate(sorted(sets))}
        weights = times[:, [place[number] for number in self.scenes]]
        told = weights[weights.any(axis=1)]
        drawn = self._medians(told) if self.median else self._means(told)
        many = len(sets)
        farther = np.sqrt(many / (many - 1)) * stats.t.isf(_TAIL, many - 1)
        tail = float(stats.norm.sf(farther))
        ends = (tail, 1 - tail)
        low, high = np.quantile(drawn, ends, method="nearest")  # Errors may be infinite.
        least, most = self._exact()
        return min(float(low), least), max(float(high), most)

    def _exact(self) -> tuple[float, float]:
        """Interval of a share of cases that are not alike; nothing of what is no share."""
        if not self.share:
            return math.inf, -math.inf
        right = int(sum(self.values))
        told = stats.binomtest(right, len(self.values)).proportion_ci(1 - 2 * _TAIL)
        return float(told.low), float(told.high)

    def _means(self, weights: NDArray[np.int64]) -> NDArray[np.float64]:
        return weights @ np.array(self.values) / weights.sum(axis=1)

    def _medians(self, weights: NDArray[np.int64]) -> NDArray[np.float64]:
        order = np.argsort(self.values)
        below = np.cumsum(weights[:, order], axis=1)
        count = below[:, -1:]
        middle = [np.argmax(below > at, axis=1) for at in ((count - 1) // 2, count // 2)]
        return np.array(self.values)[order][middle].mean(axis=0)


def figure(
    answered: Iterable[Answered],
    track: Callable[[Answered], float | None],
    *,
    median: bool = False,
) -> Figure:
    """Gather what cases tell.

    Args:
        answered: The cases.
        track: Value of a case, None where it has none; whether it is right makes a share.
        median: Take the median in place of the mean.
    """
    told = [(value, one.scenes) for one in answered if (value := track(one)) is not None]
    return Figure(
        values=tuple(float(value) for value, _ in told),
        scenes=tuple(scenes for _, scenes in told),
        median=median,
        share=all(isinstance(value, bool) for value, _ in told),
    )
