"""Comparison of a method's pose errors with those in real depth, and of two methods."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from starling.learning.icp.study import Outcome
from starling.patterns import errors
from starling.patterns.errors import whole_number


class Four(NamedTuple):
    """The paper's four metrics, or values of the same structure."""

    position_mean_pct: float
    position_var_pct: float
    rotation_mean_pct: float
    rotation_var_pct: float


@dataclass(frozen=True, kw_only=True, slots=True)
class Comparison:
    """A method compared with real depth."""

    difference: Four  # |method - real| / real [percent]; NaN if no object is visible in both.
    trials: int  # Alignments in either depth.
    objects: int  # Objects visible in both.
    hidden: int  # Objects visible in real depth only.
    shown: int  # Objects visible in the method's depth only.


@dataclass(frozen=True, kw_only=True, slots=True)
class Interval:
    """95 % interval of the advantage of one method over another [percentage points]."""

    low: Four
    middle: Four
    high: Four


def against_real(method: Outcome, real: Outcome) -> Comparison:
    """Compare mean and variance of a method's errors with those in real depth, as in Table I.

    Raises:
        InputError: if the two have different objects.
    """
    both = _seen(method, real)
    once = np.ones((1, np.count_nonzero(both)))
    values = np.full(4, np.nan)
    if both.any():
        values = _difference(_figures(method, both, once), _figures(real, both, once))[0]
    return Comparison(
        difference=Four(*values.tolist()),
        trials=real.position_m[both].size,
        objects=int(np.count_nonzero(both)),
        hidden=int(np.count_nonzero(real.visible & ~method.visible)),
        shown=int(np.count_nonzero(method.visible & ~real.visible)),
    )


def nearer(
    method: Outcome, rival: Outcome, real: Outcome, *, seed: int, draws: int = 2000
) -> Interval:
    """Bootstrap the advantage of a method: the other method's difference from real less its own.

    Objects are resampled with replacement, with all their trials and jointly for all three
    (paired). A method is nearer to real if the interval is above zero. Objects of one room are
    correlated, so that intervals are slightly too narrow.

    Args:
        method: errors of the method.
        rival: errors of the method it is compared with.
        real: errors in real depth.
        seed: seed of the draws.
        draws: 100 or more.

    Raises:
        InputError: see `against_real`; or if there are fewer draws or fewer than two objects.
    """
    whole_number("draws", draws, 100, 10**6)
    both = _seen(method, real) & rival.visible
    objects = int(np.count_nonzero(both))
    if objects < 2:
        raise errors.refuse(
            "objects seen in all", "must be two or more", objects, "Use more scenes."
        )
    generator = np.random.default_rng(seed)
    times = generator.multinomial(objects, np.full(objects, 1 / objects), size=draws)
    truth = _figures(real, both, times)
    gain = _difference(_figures(rival, both, times), truth)
    gain -= _difference(_figures(method, both, times), truth)
    low, middle, high = np.nanpercentile(gain, (2.5, 50, 97.5), axis=0).tolist()
    return Interval(low=Four(*low), middle=Four(*middle), high=Four(*high))


def _seen(method: Outcome, real: Outcome) -> NDArray[np.bool_]:
    if method.objects != real.objects:
        raise errors.refuse(
            "objects",
            "must be the same in both",
            f"{len(method.objects)} and {len(real.objects)}",
            "Give outcomes of one study.",
        )
    return method.visible & real.visible


def _figures(
    outcome: Outcome, chosen: NDArray[np.bool_], times: NDArray[np.floating | np.integer]
) -> NDArray[np.float64]:
    """Mean and variance of position, then of rotation (draws, 4), weighted by `times`."""
    columns = []
    for value in (outcome.position_m[chosen], outcome.rotation[chosen]):
        offset = value.mean()  # Subtracting it avoids cancellation in the variance.
        total = times.sum(axis=1)
        mean = times @ (value - offset).mean(axis=1) / total
        square = times @ ((value - offset) ** 2).mean(axis=1) / total
        columns += [mean + offset, square - mean**2]
    return np.stack(columns, axis=1)


def _difference(method: NDArray[np.float64], real: NDArray[np.float64]) -> NDArray[np.float64]:
    """Relative absolute difference [percent]; NaN where the real value is zero."""
    base = np.where(real > 0, real, np.nan)
    return 100 * np.abs(method - real) / base
