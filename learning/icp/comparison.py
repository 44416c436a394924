"""How near a method's pose errors come to those in real depth, and nearer than another's?"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from starling.learning.icp.study import Outcome
from starling.patterns import errors
from starling.patterns.whole import whole


class Four(NamedTuple):
    """The paper's four figures, or the same of something else."""

    position_mean_pct: float
    position_var_pct: float
    rotation_mean_pct: float
    rotation_var_pct: float


@dataclass(frozen=True, kw_only=True, slots=True)
class Comparison:
    """A method against real depth."""

    difference: Four  # |method - real| / real [percent]; NaN where no object is seen in both.
    trials: int  # Alignments that each figure stands on, in either depth.
    objects: int  # Objects seen in both.
    hidden: int  # Objects that the method hides and real depth shows.
    shown: int  # Objects that the method shows and real depth hides.


@dataclass(frozen=True, kw_only=True, slots=True)
class Interval:
    """How much nearer to real one method is than another [percentage points], 95 % intervals."""

    low: Four
    middle: Four
    high: Four


def against_real(method: Outcome, real: Outcome) -> Comparison:
    """Compare a method's mean and variance of errors with those in real depth, as in Table I.

    Raises:
        InputError: if the two have other objects.
    """
    both = _seen(method, real)
    every = np.ones((1, np.count_nonzero(both)))
    values = np.full(4, np.nan)
    if both.any():
        values = _difference(_figures(method, both, every), _figures(real, both, every))[0]
    return Comparison(
        difference=Four(*values.tolist()),
        trials=real.position_m[both].size,
        objects=int(np.count_nonzero(both)),
        hidden=int(np.count_nonzero(real.visible & ~method.visible)),
        shown=int(np.count_nonzero(method.visible & ~real.visible)),
    )


def nearer(
    method: Outcome, other: Outcome, real: Outcome, *, seed: int, draws: int = 2000
) -> Interval:
    """Bootstrap how much nearer to real a method is than another: other's less its difference.

    Objects are drawn with replacement, with all their trials and the same for all three (paired);
    a method is nearer where the interval lies above zero. Objects of one room are alike, so
    intervals are somewhat too narrow.

    Args:
        method: whose gain is asked for.
        other: the rival.
        real: errors in real depth.
        seed: fixes the draws.
        draws: 100 or more.

    Raises:
        InputError: as `against_real`, or with fewer draws or two objects.
    """
    whole("draws", draws, 100, 10**6)
    both = _seen(method, real) & other.visible
    objects = int(np.count_nonzero(both))
    if objects < 2:
        raise errors.refuse("objects seen in all", "must be two or more", objects, "Take more.")
    generator = np.random.default_rng(seed)
    times = generator.multinomial(objects, np.full(objects, 1 / objects), size=draws)
    truth = _figures(real, both, times)
    gain = _difference(_figures(other, both, times), truth)
    gain -= _difference(_figures(method, both, times), truth)
    low, middle, high = np.nanpercentile(gain, (2.5, 50, 97.5), axis=0).tolist()
    return Interval(low=Four(*low), middle=Four(*middle), high=Four(*high))


def _seen(method: Outcome, real: Outcome) -> NDArray[np.bool_]:
    if method.objects != real.objects:
        raise errors.refuse(
            "objects",
            "must be the same in both",
            f"{len(method.objects)} and {len(real.objects)}",
            "Take both outcomes from one study.",
        )
    return method.visible & real.visible


def _figures(
    outcome: Outcome, chosen: NDArray[np.bool_], times: NDArray[np.floating | np.integer]
) -> NDArray[np.float64]:
    """Mean and variance of position, then of rotation (draws, 4), objects counted `times`."""
    columns = []
    for value in (outcome.position_m[chosen], outcome.rotation[chosen]):
        offset = value.mean()  # Variances are small differences of large sums without it.
        total = times.sum(axis=1)
        mean = times @ (value - offset).mean(axis=1) / total
        square = times @ ((value - offset) ** 2).mean(axis=1) / total
        columns += [mean + offset, square - mean**2]
    return np.stack(columns, axis=1)


def _difference(method: NDArray[np.float64], real: NDArray[np.float64]) -> NDArray[np.float64]:
    """Relative absolute difference [percent]; NaN where the real figure is zero."""
    base = np.where(real > 0, real, np.nan)
    return 100 * np.abs(method - real) / base
