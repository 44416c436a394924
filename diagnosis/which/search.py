"""Effects that made a gap: found by held-out gain, simulated together, tried against rivals."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from diagnosis.rooms import draws
from diagnosis.which.bench import Bench, Table
from diagnosis.which.candidates import Candidate
from diagnosis.which.fit import Fit, fit, held_out, places
from diagnosis.which.likelihood import Likelihood
from diagnosis.which.signature import Signature, signature, with_node
from sim.effects.effect import Value

MOST = 4  # Effects in one verdict.
_SHARP = 4  # Candidates that are simulated where they fit best,
_NEAR = 0.25  # if they gain nearly as much as the best: all but this share.
_AT_A_NODE = 0.1  # Places from a node within which nothing is simulated anew.
_PAIRED = 8  # Candidates among which pairs are tried.
_COARSE = 2  # Places between nodes where pairs are tried.
_ROUNDS = 3  # Of fitting each effect given the others.
_LEVEL = 0.9  # Of intervals.
_DRAWS = 400
_SAME = 0.05  # Chance that a rival is as good, above which it cannot be told apart.

Folds = Sequence[NDArray[np.bool_]]


@dataclass(frozen=True, slots=True, eq=False)
class Model:
    """Effects that act together."""

    terms: tuple[Signature, ...]
    places: tuple[float, ...]
    beside: Table  # What they make together beyond the sum of what each makes alone.

    @property
    def settings(self) -> dict[str, Value]:
        """Value by effect."""
        return {
            one.name: one.value(place) for one, place in zip(self.terms, self.places, strict=True)
        }

    def made(self, *, without: int | None = None) -> Table:
        """What they make (scenes, features), all or all but one."""
        total = self.beside.copy()
        for number, (one, place) in enumerate(zip(self.terms, self.places, strict=True)):
            if number != without:
                total = total + one.at(place)
        return total

    def only(self, numbers: Sequence[int], beside: Table) -> Model:
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


def coarse(candidate: Candidate) -> list[Value]:
    """Nodes at which a candidate is tried first: all words; of numbers, whole ones too, a weak and
    a strong one to each side.

    A strong one alone would do for effects that grow in proportion; but few do.
    """
    if any(isinstance(node, str) for node in candidate.nodes):
        return list(candidate.nodes)
    base = float(candidate.base)
    below = [node for node in candidate.nodes if float(node) < base][::-1]
    above = [node for node in candidate.nodes if float(node) > base]
    found = [side[at] for side in (below, above) for at in _tried(len(side))]
    return sorted(found, key=float)


def fine(fit: Fit) -> list[Value]:
    """Nodes of a candidate that is worth it: all to the side where it fits, else those tried first.

    Args:
        fit: of those tried first.
    """
    candidate = fit.signature.candidate
    if not candidate.numeric:
        return list(candidate.nodes)
    base, tried = float(candidate.base), coarse(candidate)
    above = float(fit.value) >= base
    return [node for node in candidate.nodes if node in tried or (float(node) > base) == above]


def _tried(count: int) -> list[int]:
    """Which of so many nodes, from weak to strong, are tried."""
    return sorted({count // 3, count - 1 - count // 4}) if count else []


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
    signatures = [
        one
        for one in (signature(each.signature.candidate, bench, fine(each)) for each in closer)
        if one is not None
    ]
    signatures = _sharper(signatures, bench, likelihood, folds, threshold)
    starts = _starts(signatures, likelihood, folds, threshold)
    nothing = Model((), (), likelihood.nothing)
    model = next(filter(None, (_simulated(bench, likelihood, one) for one in starts)), nothing)
    while model.terms and len(model.terms) < MOST:
        wider = _wider(model, bench, likelihood, signatures, folds, threshold)
        if wider is None:
            break
        model = wider
    model = _thinned(bench, likelihood, model, threshold)
    if likelihood.size(model.made()) > explained_below:
        whole = _completed(model, bench, likelihood, alone, folds, threshold)
        if whole is not model:
            model = _thinned(bench, likelihood, whole, threshold)
    return Search(
        accepted=tuple(
            _accepted(number, model, bench, signatures, likelihood, folds, threshold)
            for number in range(len(model.terms))
        ),
        threshold=threshold,
        alone=tuple(alone),
        before=likelihood.size(likelihood.nothing),
        after=likelihood.size(model.made()),
        left=likelihood.left(model.made()),
    )


def _sharper(
    signatures: Sequence[Signature],
    bench: Bench,
    likelihood: Likelihood,
    folds: Folds,
    threshold: float,
) -> list[Signature]:
    """Simulate the best alone, and those that come near it, at the strength where each fits.

    Between nodes an effect is only as right as a straight line is, and that must not decide.
    """
    ranked = _ranked(signatures, likelihood, folds, likelihood.nothing)[:_SHARP]
    near = {
        one.name: one.value
        for one in ranked
        if one.total > ranked[0].total - max(threshold, _NEAR * ranked[0].total)
        and one.signature.candidate.numeric
        and abs(one.place - round(one.place)) > _AT_A_NODE
    }
    return [
        with_node(one, near[one.name], bench) if one.name in near else one for one in signatures
    ]


def _ranked(
    signatures: Sequence[Signature], likelihood: Likelihood, folds: Folds, given: Table
) -> list[Fit]:
    """Fit every candidate on top of others, those that gain most first."""
    fits = [fit(one, likelihood, folds, given=given) for one in signatures]
    return sorted(fits, key=lambda one: -one.total)


def _starts(
    signatures: Sequence[Signature], likelihood: Likelihood, folds: Folds, threshold: float
) -> list[Model]:
    """Two effects that gain more than any single one, the best such pair first; the best effect."""
    ranked = _ranked(signatures, likelihood, folds, likelihood.nothing)
    if not ranked or ranked[0].total < threshold:
        return []
    best = ranked[0]
    pairs: list[tuple[float, Model]] = []
    for one, other in itertools.combinations(ranked[:_PAIRED], 2):
        gain, best_at = _both(one.signature, other.signature, likelihood, folds)
        if gain > best.total + threshold:
            terms = (one.signature, other.signature)
            pairs.append((gain, Model(terms, best_at, likelihood.nothing)))
    pairs.sort(key=lambda each: -each[0])
    alone = Model((best.signature,), (best.place,), likelihood.nothing)
    return [*(model for _, model in pairs), alone]


def _wider(
    model: Model,
    bench: Bench,
    likelihood: Likelihood,
    signatures: Sequence[Signature],
    folds: Folds,
    threshold: float,
) -> Model | None:
    """Add the effect that gains most, if it gains enough."""
    used = {one.name for one in model.terms}
    rest = [one for one in signatures if one.name not in used]
    for best in _ranked(rest, likelihood, folds, model.made()):
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
    made = [
        np.stack([each.at(p) for p in at]) for each, at in zip((one, other), tried, strict=True)
    ]
    both = (made[0][:, None] + made[1][None]).reshape(len(pairs), *likelihood.gap.shape)
    cost = likelihood.cost(both)
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
        alone = Model(model.terms, model.places, np.zeros_like(together)).made()
        model = _fitted(likelihood, Model(model.terms, model.places, together - alone))
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


def _accepted(
    number: int,
    model: Model,
    bench: Bench,
    signatures: Sequence[Signature],
    likelihood: Likelihood,
    folds: Folds,
    threshold: float,
) -> Accepted:
    given = model.made(without=number)
    own = fit(model.terms[number], likelihood, folds, given=given)
    used = {one.name for one in model.terms}
    others = [
        fit(one, likelihood, folds, given=given) for one in signatures if one.name not in used
    ]
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

    As much as an effect has to gain to be named, one has to gain over another to be told from it.
    """
    times = draws(rooms, _DRAWS, np.random.default_rng(0))
    found = [
        other
        for other in others
        if other.total > max(0.0, own.total - threshold)
        or (other.total > 0 and np.mean(times @ (other.gain - own.gain) >= 0) > _SAME)
    ]
    return tuple(sorted(found, key=lambda one: -one.total))
