"""Which effects made a gap: one is added after the other, while held-out scenes gain from it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from diagnosis.fit import Fit, fit
from diagnosis.likelihood import Likelihood
from diagnosis.null import Base
from diagnosis.signature import Bench, Signature, Table
from patterns.errors import InputError
from sim.effects.effect import Value

MOST = 4  # Effects in one verdict.
_LEVEL = 0.9  # Of intervals.
_DRAWS = 400
_SAME = 0.05  # Chance that a rival is as good, above which it cannot be told apart.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Accepted:
    """An effect that held-out scenes gain from."""

    fit: Fit
    interval: tuple[Value, Value]
    rivals: tuple[str, ...]  # Other candidates that the data cannot tell from it.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Search:
    """What was found in one arm."""

    accepted: tuple[Accepted, ...]
    threshold: float
    fits: tuple[Fit, ...]  # All candidates fitted alone, best first.
    before: float  # Root mean square of the gap over its deviation.
    after: float
    left: Table = field(repr=False)  # (scenes, features) over deviation, what is not explained.

    @property
    def explained(self) -> float:
        """Share of the gap's excess over chance that the accepted effects explain."""
        excess = max(self.before**2 - 1, 1e-9)
        return float(np.clip(1 - max(self.after**2 - 1, 0) / excess, 0, 1))


def search(
    bench: Bench,
    of: Base,
    signatures: Sequence[Signature],
    folds: Sequence[NDArray[np.bool_]],
    *,
    threshold: float,
    real: Table | None = None,
) -> Search:
    """Add effects greedily, simulating all accepted ones together after each step.

    Args:
        bench: subjects and arm.
        of: the base.
        signatures: of all candidates.
        folds: scenes held out.
        threshold: least gain of an effect.
        real: features of the readings; None takes the bench's own.
    """
    real = bench.real() if real is None else real
    likelihood = of.likelihood(real)
    alone = _ranked(signatures, likelihood, folds)
    start, fits = likelihood, alone
    accepted: list[Accepted] = []
    settings: dict[str, Value] = {}
    while len(accepted) < MOST and fits and fits[0].gain.sum() >= threshold:
        best = fits[0]
        settings[best.name] = best.value
        table = _simulated(bench, of, settings)
        if table is None:
            break
        accepted.append(
            Accepted(
                fit=best,
                interval=best.interval(level=_LEVEL, seed=0),
                rivals=_rivals(best, fits),
            )
        )
        likelihood = start.beyond(table - of.mean)
        rest = [one for one in signatures if one.candidate.name not in settings]
        fits = _ranked(rest, likelihood, folds)
    return Search(
        accepted=tuple(accepted),
        threshold=threshold,
        fits=tuple(alone),
        before=start.size,
        after=likelihood.size,
        left=likelihood.gap / likelihood.deviation,
    )


def _ranked(
    signatures: Sequence[Signature], likelihood: Likelihood, folds: Sequence[NDArray[np.bool_]]
) -> list[Fit]:
    """Fit every candidate alone, those that gain most first."""
    fits = [fit(one, likelihood, folds) for one in signatures]
    return sorted(fits, key=lambda one: -one.gain.sum())


def _simulated(bench: Bench, of: Base, settings: Mapping[str, Value]) -> Table | None:
    """What the effects make together, on top of the base's mean; None where they exclude others."""
    try:
        return of.mean + bench.simulated(settings) - of.tables[0]
    except InputError:
        return None


def _rivals(best: Fit, fits: Sequence[Fit]) -> tuple[str, ...]:
    """Candidates whose held-out gain, scene by scene, is not surely less."""
    rng = np.random.default_rng(0)
    scenes = len(best.gain)
    times = rng.multinomial(scenes, np.full(scenes, 1 / scenes), size=_DRAWS)
    found = []
    for other in fits:
        if other.name == best.name or other.gain.sum() <= 0:
            continue
        if np.mean(times @ (other.gain - best.gain) >= 0) > _SAME:
            found.append(other.name)
    return tuple(found)
