"""Effects that made a gap: found by held-out gain, simulated together, tried against rivals."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from diagnosis.rooms import draws
from diagnosis.which.bench import Bench, Table
from diagnosis.which.fit import Fit, Folds, fit, held_out, places
from diagnosis.which.likelihood import Likelihood
from diagnosis.which.made import Made, stacked
from diagnosis.which.signature import Signature, signature
from diagnosis.which.strengths import coarse, sharper
from sim.effects.effect import Value

MOST = 4  # Effects in one verdict.
_PAIRED = 8  # Candidates among which pairs are tried.
_COARSE = 4  # Places between nodes where pairs are tried.
_ROUNDS = 3  # Of fitting each effect given the others.
_LEVEL = 0.9  # Of intervals.
_DRAWS = 400
_OF_GAIN = 0.1  # Share of its own gain that an effect has to gain over another.
_SAME = 0.05  # Chance that a rival is as good, above which it cannot be told apart.


@dataclass(frozen=True, slots=True, eq=False)
class Model:
    """Effects that act together."""

    terms: tuple[Signature, ...]
    places: tuple[float, ...]
    beside: Made  # What they make together beyond the sum of what each makes alone.

    @property
    def settings(self) -> dict[str, Value]:
        """Value by effect."""
        return {
            one.name: one.value(place) for one, place in zip(self.terms, self.places, strict=True)
        }

    def made(self, *, without: int | None = None) -> Made:
        """What they make, all or all but one."""
        total = self.beside
        for number, (one, place) in enumerate(zip(self.terms, self.places, strict=True)):
            if number != without:
                total = total + one.at(place)
        return total

    def others(self, signatures: Sequence[Signature]) -> list[Signature]:
        """Those that are none of its effects."""
        used = {one.name for one in self.terms}
        return [one for one in signatures if one.name not in used]

    def only(self, numbers: Sequence[int], beside: Made) -> Model:
        """Some of the effects, as strong as they are here.

        Args:
            numbers: which.
            beside: what these make together.
        """
        terms = tuple(self.terms[n] for n in numbers)
        return Model(terms, tuple(self.places[n] for n in numbers), beside)


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Accepted:
    """An effect that held-out scenes gain from."""

    fit: Fit  # Given the others.
    interval: tuple[Value, Value]
    rivals: tuple[Fit, ...]  # Other candidates, in its place, that the data cannot tell from it.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Search:
    """What was found in one arm."""

    accepted: tuple[Accepted, ...]
    threshold: float
    alone: tuple[Fit, ...]  # All candidates fitted alone, best first.
    before: float  # Size of the gap (`Likelihood.size`).
    after: float
    left: Table = field(repr=False)  # (scenes, features) what is not explained, over deviation.

    @property
    def settings(self) -> dict[str, Value]:
        """Value by accepted effect."""
        return {one.fit.name: one.fit.value for one in self.accepted}


def search(
    bench: Bench,
    likelihood: Likelihood,
    closer: Sequence[Fit],
    alone: Sequence[Fit],
    folds: Folds,
    *,
    threshold: float,
    explained_below: float = 0.0,
) -> Search:
    """Add effects while held-out scenes gain, simulating all accepted ones together.

    Args:
        bench: subjects and arm.
        likelihood: of the gap.
        closer: candidates worth a closer look, fitted alone at few strengths.
        alone: all candidates fitted so, best first.
        folds: scenes held out.
        threshold: least gain of an effect.
        explained_below: size of what is left up to which nothing else is looked for.
    """
    rough = [one.signature for one in closer]
    first = sharper(rough, bench, likelihood, folds, threshold, likelihood.nothing)
    signatures = [one.signature for one in first]
    starts = _starts(first, likelihood, folds, threshold)
    nothing = Model((), (), likelihood.nothing)
    model = next(filter(None, (_simulated(bench, likelihood, one) for one in starts)), nothing)
    model = _grown(model, bench, likelihood, signatures, folds, threshold)
    if likelihood.size(model.made()) > explained_below:
        other = _exchanged(model, bench, likelihood, signatures, folds, threshold)
        if other is not model:
            model = _grown(other, bench, likelihood, signatures, folds, threshold)
    if likelihood.size(model.made()) > explained_below:
        whole = _completed(model, bench, likelihood, alone, folds, threshold)
        if whole is not model:
            model = _thinned(bench, likelihood, whole, threshold)
    model = _borne_out(bench, likelihood, model, folds, threshold)
    explained = likelihood.size(model.made()) <= explained_below
    return Search(
        accepted=tuple(
            _accepted(number, model, bench, signatures, likelihood, folds, threshold, explained)
            for number in range(len(model.terms))
        ),
        threshold=threshold,
        alone=tuple(alone),
        before=likelihood.size(likelihood.nothing),
        after=likelihood.size(model.made()),
        left=likelihood.left(model.made()),
    )


def _starts(
    first: Sequence[Fit], likelihood: Likelihood, folds: Folds, threshold: float
) -> list[Model]:
    """Two effects that gain more than any single one, the best such pair first; the best effect."""
    if not first or first[0].total < threshold:
        return []
    best = first[0]
    pairs: list[tuple[float, Model]] = []
    for one, other in itertools.combinations(first[:_PAIRED], 2):
        gain, best_at = _both(one.signature, other.signature, likelihood, folds)
        if gain > best.total + threshold:
            terms = (one.signature, other.signature)
            pairs.append((gain, Model(terms, best_at, likelihood.nothing)))
    pairs.sort(key=lambda each: -each[0])
    alone = Model((best.signature,), (best.place,), likelihood.nothing)
    return [*(model for _, model in pairs), alone]


def _grown(
    model: Model,
    bench: Bench,
    likelihood: Likelihood,
    signatures: Sequence[Signature],
    folds: Folds,
    threshold: float,
) -> Model:
    """Add effects while they gain enough; leave out what the others then make up for."""
    while model.terms and len(model.terms) < MOST:
        wider = _wider(model, bench, likelihood, signatures, folds, threshold)
        if wider is None:
            break
        model = wider
    return _thinned(bench, likelihood, model, threshold)


def _exchanged(
    model: Model,
    bench: Bench,
    likelihood: Likelihood,
    signatures: Sequence[Signature],
    folds: Folds,
    threshold: float,
) -> Model:
    """Put others in the places of effects that they gain more than, given the rest.

    The first may be a compromise of two effects, which shows once one of these is beside it.
    """
    for _ in range(_ROUNDS):
        rest = model.others(signatures)
        better: list[tuple[float, int, Fit]] = []
        for number, term in enumerate(model.terms):
            given = model.made(without=number)
            own = fit(term, likelihood, folds, given=given).total
            others = (fit(one, likelihood, folds, given=given) for one in rest)
            better += [(other.total - own, number, other) for other in others]
        more, number, best = max(better, key=lambda each: each[0], default=(0.0, 0, None))
        if best is None or more < threshold:
            break
        terms, at = list(model.terms), list(model.places)
        terms[number], at[number] = best.signature, best.place
        other = _simulated(bench, likelihood, Model(tuple(terms), tuple(at), model.beside))
        if other is None or _gain(likelihood, other, model) < threshold:
            break
        model = other
    return model


def _wider(
    model: Model,
    bench: Bench,
    likelihood: Likelihood,
    signatures: Sequence[Signature],
    folds: Folds,
    threshold: float,
) -> Model | None:
    """Add the effect that gains most, if it gains enough."""
    rest = model.others(signatures)
    for best in sharper(rest, bench, likelihood, folds, threshold, model.made()):
        if best.total < threshold:
            break
        wider = Model((*model.terms, best.signature), (*model.places, best.place), model.beside)
        wider = _simulated(bench, likelihood, wider)
        if wider is not None and _gain(likelihood, wider, model) >= threshold:
            return wider  # Else the next.
    return None


def _completed(
    model: Model,
    bench: Bench,
    likelihood: Likelihood,
    alone: Sequence[Fit],
    folds: Folds,
    threshold: float,
) -> Model:
    """Add other parameters of the accepted effects, which alone do nothing, where they gain enough.

    Where a second projector stands shows only once it shines.
    """
    idle = [one.signature.candidate for one in alone if not one.signature.change.any()]
    for term in model.terms:
        for candidate in (one for one in idle if one.effect is term.candidate.effect):
            beside = signature(candidate, bench, coarse(candidate), given=model.settings)
            if beside is None:
                continue
            best = fit(beside, likelihood, folds, given=model.made())
            if best.total < threshold:
                continue
            wider = Model((*model.terms, beside), (*model.places, best.place), model.beside)
            wider = _simulated(bench, likelihood, wider)
            if wider is not None and _gain(likelihood, wider, model) >= threshold:
                model = wider
    return model


def _both(
    one: Signature, other: Signature, likelihood: Likelihood, folds: Folds
) -> tuple[float, tuple[float, float]]:
    """Fit two effects at once."""
    tried = [places(each, _COARSE) for each in (one, other)]
    pairs = list(itertools.product(*tried))
    cost = likelihood.cost(stacked([one.at(first) + other.at(second) for first, second in pairs]))
    gain = held_out(cost, likelihood.cost(likelihood.nothing), folds)
    return float(gain.sum()), pairs[int(np.argmin(cost.sum(axis=1)))]


def _simulated(bench: Bench, likelihood: Likelihood, model: Model) -> Model | None:
    """Fit strengths, simulate the effects together, and fit again with what that adds.

    None where they exclude each other in this sensor.
    """
    model = _fitted(likelihood, model)
    for _ in range(2):
        together = bench.change(model.settings)
        if together is None:
            return None
        alone = Model(model.terms, model.places, likelihood.nothing).made()
        beside = Made(together - alone.change)
        model = _fitted(likelihood, Model(model.terms, model.places, beside))
    return model


def _fitted(likelihood: Likelihood, model: Model) -> Model:
    """Fit each effect given the others, round by round."""
    every = [np.ones(len(likelihood.gap), bool)]
    for _ in range(_ROUNDS if len(model.terms) > 1 else 1):
        for number, one in enumerate(model.terms):
            found = fit(one, likelihood, every, given=model.made(without=number))
            moved = (*model.places[:number], found.place, *model.places[number + 1 :])
            model = Model(model.terms, moved, model.beside)
    return model


def _gain(likelihood: Likelihood, model: Model, other: Model) -> float:
    return float((likelihood.cost(other.made()) - likelihood.cost(model.made())).sum())


def _thinned(bench: Bench, likelihood: Likelihood, model: Model, threshold: float) -> Model:
    """Leave out effects that the others make up for, and those that were fitted to their base."""
    acting = [
        n for n, one in enumerate(model.terms) if model.settings[one.name] != one.candidate.base
    ]
    model = model.only(acting, model.beside)
    for number in reversed(range(len(model.terms))):
        if len(model.terms) < 2:
            break
        kept = [n for n in range(len(model.terms)) if n != number]
        less = _simulated(bench, likelihood, model.only(kept, likelihood.nothing))
        if less is not None and _gain(likelihood, model, less) < threshold:
            model = less
    return model


def _borne_out(
    bench: Bench, likelihood: Likelihood, model: Model, folds: Folds, threshold: float
) -> Model:
    """Leave out what, simulated with the others, no longer gains enough on held-out scenes."""
    while model.terms:
        gains = [
            fit(one, likelihood, folds, given=model.made(without=number)).total
            for number, one in enumerate(model.terms)
        ]
        worst = int(np.argmin(gains))
        if gains[worst] >= threshold:
            break
        kept = [number for number in range(len(gains)) if number != worst]
        less = _simulated(bench, likelihood, model.only(kept, likelihood.nothing))
        if less is None:
            break
        model = less
    return model


def _accepted(
    number: int,
    model: Model,
    bench: Bench,
    signatures: Sequence[Signature],
    likelihood: Likelihood,
    folds: Folds,
    threshold: float,
    explained: bool,
) -> Accepted:
    """What is told of one of the accepted; of stand-ins no rival is simulated closer."""
    given = model.made(without=number)
    rest = model.others(signatures)
    own = fit(model.terms[number], likelihood, folds, given=given)
    if explained:
        others = sharper(rest, bench, likelihood, folds, threshold, given, gained=own.total)
    else:
        others = [fit(one, likelihood, folds, given=given) for one in rest]
    rooms = [one.room for one in bench.subjects]
    return Accepted(
        fit=own,
        interval=own.interval(rooms, level=_LEVEL, seed=0),
        rivals=_rivals(own, others, rooms, threshold),
    )


def _rivals(
    own: Fit, others: Sequence[Fit], rooms: Sequence[str], threshold: float
) -> tuple[Fit, ...]:
    """Candidates that gain nearly as much, or about as much room by room.

    As much as an effect has to gain to be named, one has to gain over another to be told from it;
    and a share of all that it gains, as no effect is simulated as it truly is.
    """
    margin = max(threshold, _OF_GAIN * own.total)
    times = draws(rooms, _DRAWS, np.random.default_rng(0))
    found = [
        other
        for other in others
        if other.total > max(0.0, own.total - margin)
        or (other.total > 0 and np.mean(times @ (other.gain - own.gain) >= 0) > _SAME)
    ]
    return tuple(sorted(found, key=lambda one: -one.total))
