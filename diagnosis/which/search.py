"""Effects that made a gap: found by held-out gain, simulated together, tried against rivals."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from starling.diagnosis.scenes.rooms import draws
from starling.diagnosis.which.candidates import Candidate
from starling.diagnosis.which.fit import Fit, held_out, places
from starling.diagnosis.which.model import ROUNDS, Model, simulated
from starling.diagnosis.which.predicted import Made, stacked
from starling.diagnosis.which.response import Signature, signature
from starling.diagnosis.which.strengths import coarse, sharper
from starling.diagnosis.which.table import Table
from starling.diagnosis.which.trial import Trial
from starling.sim.effects.effect import Stage, Value

MOST = 4  # Effects in one verdict.
_CLOSER = 12  # Candidates that are simulated at more strengths,
_WORTH_IT = 0.25  # if they gain this share of the threshold.
_PAIRED = 8  # Candidates among which pairs are tried.
_COARSE = 4  # Places between nodes where pairs are tried.
_BEGUN = 3  # Of the best, that are simulated until one is better.
_LEVEL = 0.9  # Of intervals.
_DRAWS = 400
_OF_GAIN = 0.1  # Share of its own gain that an effect has to gain over another.
_AS_LIKELY = 3.0  # Difference of log likelihoods that is hardly any: odds of 20 to 1.
_ENOUGH = 0.5  # Of the threshold, that one gains which alone leaves nothing of a gap unexplained.
_SAME = 0.05  # Chance that a rival is as good, above which it cannot be told apart.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Accepted:
    """An effect that held-out scenes gain from."""

    fit: Fit  # Given the others.
    interval: tuple[Value, Value]
    rivals: tuple[Fit, ...]  # Other candidates, in its place, that the data cannot tell from it.
    rival_intervals: tuple[tuple[Value, Value], ...]


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Search:
    """What was found in one arm."""

    accepted: tuple[Accepted, ...]
    threshold: float
    alone: tuple[Fit, ...]  # All candidates fitted alone, best first.
    left: Table = field(repr=False)  # (scenes, features) what of the gap is left.
    beyond: Table = field(repr=False)  # What is left beyond what the accepted may be wrong by.

    @property
    def settings(self) -> dict[str, Value]:
        """Value by accepted effect."""
        return {one.fit.name: one.fit.value for one in self.accepted}


def search(trial: Trial, closer: Sequence[Fit], alone: Sequence[Fit]) -> Search:
    """Add effects while held-out scenes gain, simulating all accepted ones together.

    Args:
        trial: the arm's.
        closer: candidates worth a closer look, fitted alone at few strengths.
        alone: all candidates fitted so, best first.
    """
    likelihood = trial.likelihood
    first = sharper([one.signature for one in closer], trial, likelihood.nothing)
    known = {one.name for one in first}
    rest = [one for one in alone if one.name not in known]
    signatures = [one.signature for one in (*first, *rest)]
    model = _grown(_begun(first, trial, alone), trial, signatures)
    if not trial.explained(model.made()):
        other = _exchanged(model, trial, signatures)
        if other is not model:
            model = _grown(other, trial, signatures)
    if not trial.explained(model.made()):
        whole = _completed(model, trial, alone)
        if whole is not model:
            model = _thinned(whole, trial)
    model = _sensors_first(_borne_out(model, trial), trial, signatures)
    return Search(
        accepted=tuple(
            _accepted(number, model, trial, signatures) for number in range(len(model.terms))
        ),
        threshold=trial.threshold,
        alone=tuple(alone),
        left=likelihood.left(model.made()),
        beyond=likelihood.beyond(model.made()),
    )


def worth(fits: Iterable[Fit], threshold: float) -> list[Fit]:
    """Candidates worth a closer look, the best first.

    Args:
        fits: of all.
        threshold: least gain of an effect.
    """
    best = sorted(fits, key=lambda one: -one.total)[:_CLOSER]
    return [one for one in best if one.total > _WORTH_IT * threshold]


def _begun(first: Sequence[Fit], trial: Trial, every: Sequence[Fit]) -> Model:
    """The best effect, or two that gain enough over it, simulated together; below the threshold one
    that explains the gap, or none.

    What two make one by one does not add up where they are strong: a sum may outdo the one effect
    that is there, by what no simulation bears out. And two may make up for where a second projector
    stands, which is none of the sums' parameters.
    """
    nothing = Model((), (), trial.likelihood.nothing)
    if not first or first[0].total < trial.threshold:
        return _enough(first, trial)
    enough = [nothing.wider(one) for one in first if one.total >= trial.threshold]
    alone = _first(simulated(trial, one) for one in enough[:_BEGUN]) or nothing
    if not trial.explained(alone.made()):
        alone = _completed(alone, trial, every)
    pairs = _pairs(first, trial)[:_BEGUN]
    return _first(_better(pair, alone, trial) for pair in pairs) or alone


def _first(found: Iterable[Model | None]) -> Model | None:
    """The first that there is; none after it is looked for."""
    return next((one for one in found if one is not None), None)


def _enough(first: Sequence[Fit], trial: Trial) -> Model:
    """The best effect that alone leaves nothing of a gap unexplained, or none.

    The threshold is what tells an effect from no gap. Where there plainly is a gap, to call it none
    of the known effects is wrong where one of them explains it.
    """
    nothing = Model((), (), trial.likelihood.nothing)
    for one in first:
        if one.total < _ENOUGH * trial.threshold:
            break
        alone = simulated(trial, nothing.wider(one))
        if alone is not None and _is_enough(alone, trial):
            return alone
    return nothing


def _is_enough(model: Model, trial: Trial) -> bool:
    """Whether a model is one effect that alone leaves nothing of a gap unexplained."""
    gap = not trial.explained(trial.likelihood.nothing)
    return gap and len(model.terms) == 1 and trial.explained(model.made())


def _pairs(first: Sequence[Fit], trial: Trial) -> list[Model]:
    """Two effects whose sum gains more than any single one, the best such pair first."""
    best, nothing = first[0], trial.likelihood.nothing
    pairs: list[tuple[float, Model]] = []
    for one, other in itertools.combinations(first[:_PAIRED], 2):
        gain, best_at = _both(one.signature, other.signature, trial)
        if gain > best.total + trial.threshold:
            pairs.append((gain, Model((one.signature, other.signature), best_at, nothing)))
    return [model for _, model in sorted(pairs, key=lambda each: -each[0])]


def _both(one: Signature, other: Signature, trial: Trial) -> tuple[float, tuple[float, float]]:
    """Fit two effects at once."""
    likelihood = trial.likelihood
    tried = [places(each, _COARSE) for each in (one, other)]
    pairs = list(itertools.product(*tried))
    cost = likelihood.cost(stacked([one.at(first) + other.at(second) for first, second in pairs]))
    gain = held_out(cost, likelihood.cost(likelihood.nothing), trial.folds)
    return float(gain.sum()), pairs[int(np.argmin(cost.sum(axis=1)))]


def _grown(model: Model, trial: Trial, signatures: Sequence[Signature]) -> Model:
    """Add effects while they gain enough; leave out what the others then make up for."""
    while model.terms and len(model.terms) < MOST:
        wider = _wider(model, trial, signatures)
        if wider is None:
            break
        model = wider
    return _thinned(model, trial)


def _wider(model: Model, trial: Trial, signatures: Sequence[Signature]) -> Model | None:
    """Add the effect that gains most, if it gains enough; else the next.

    Alone the best are what looks like one that is strong: beside it, it is others. Where none is
    enough and much is left, the best alone are simulated beside it all the same: what two make
    together may be far from their sum, as depth cut off where holes are filled.
    """
    given, others = model.made(), model.others(signatures)
    beside = _likely(others, trial, given=given)
    likely = sharper([one.signature for one in beside], trial, given)
    enough = (one for one in likely if one.total >= trial.threshold)
    wider = _first(_better(model.wider(one), model, trial) for one in enough)
    if wider is not None or trial.explained(given):
        return wider
    alone = _likely(others, trial)[:_BEGUN]
    apart = (one.signature.candidate for one in alone if one.total >= trial.threshold)
    return _first(_joined(one, model, trial) for one in apart)


def _likely(
    signatures: Sequence[Signature], trial: Trial, *, given: Made | None = None
) -> list[Fit]:
    """Of some candidates those worth a closer look beside what others make."""
    return worth((trial.fit(one, given=given) for one in signatures), trial.threshold)


def _joined(candidate: Candidate, model: Model, trial: Trial) -> Model | None:
    """Add an effect as it is simulated beside the others, if it gains enough."""
    beside = signature(candidate, trial.bench, coarse(candidate), given=model.settings)
    if beside is None:
        return None
    (best,) = sharper([beside], trial, model.made())
    return _better(model.wider(best), model, trial) if best.total >= trial.threshold else None


def _better(other: Model, model: Model, trial: Trial) -> Model | None:
    """Another model, simulated, if it gains enough over the one at hand."""
    found = simulated(trial, other)
    if found is None or found.gain(model, trial.likelihood) < trial.threshold:
        return None
    return found


def _exchanged(model: Model, trial: Trial, signatures: Sequence[Signature]) -> Model:
    """Put others in the places of effects that they gain more than, given the rest.

    The first may be a compromise of two effects, which shows once one of these is beside it.
    """
    for _ in range(ROUNDS):
        rest = model.others(signatures)
        gains: list[tuple[float, Model]] = []
        for number, term in enumerate(model.terms):
            given = model.made(without=number)
            own = trial.fit(term, given=given).total
            others = (trial.fit(one, given=given) for one in rest)
            gains += [(one.total - own, model.exchanged(number, one)) for one in others]
        enough = [one for one in gains if one[0] >= trial.threshold]
        likely = sorted(enough, key=lambda each: -each[0])[:_BEGUN]
        other = _first(_better(one, model, trial) for _, one in likely)
        if other is None:
            break
        model = other
    return model


def _completed(model: Model, trial: Trial, alone: Sequence[Fit]) -> Model:
    """Add other parameters of the accepted effects, which alone do nothing, where they gain enough.

    Where a second projector stands shows only once it shines.
    """
    idle = [one.signature.candidate for one in alone if not one.signature.change.any()]
    accepted = {term.candidate.effect.name for term in model.terms}
    for candidate in (one for one in idle if one.effect.name in accepted):
        if candidate.name not in model.settings:
            model = _joined(candidate, model, trial) or model
    return model


def _thinned(model: Model, trial: Trial) -> Model:
    """Leave out effects that the others make up for, and those that were fitted to their base."""
    while len(acting := _acting(model)) < len(model.terms):
        less = model.only(acting, trial.likelihood.nothing)
        model = simulated(trial, less) or less
    for number in reversed(range(len(model.terms))):
        if len(model.terms) < 2:
            break
        less = _without(number, model, trial)
        if less is not None and model.gain(less, trial.likelihood) < trial.threshold:
            model = less
    return model


def _acting(model: Model) -> list[int]:
    values = model.settings
    return [n for n, one in enumerate(model.terms) if values[one.name] != one.candidate.base]


def _borne_out(model: Model, trial: Trial) -> Model:
    """Leave out what, simulated with the others, no longer gains enough on held-out scenes."""
    while model.terms:
        least = (_ENOUGH if _is_enough(model, trial) else 1) * trial.threshold
        gains = [_own(number, model, trial)[0].total for number in range(len(model.terms))]
        worst = int(np.argmin(gains))
        if gains[worst] >= least or (less := _without(worst, model, trial)) is None:
            break
        model = less
    return model


def _own(number: int, model: Model, trial: Trial) -> tuple[Fit, Made | None]:
    """One of the effects with what it gains over the others, simulated without it, and what these
    make; None where the sensor cannot have them so.
    """
    less = _without(number, model, trial)
    over = None if less is None else less.made()
    return trial.fit(model.terms[number], given=model.made(without=number), over=over), over


def _without(number: int, model: Model, trial: Trial) -> Model | None:
    kept = [n for n in range(len(model.terms)) if n != number]
    return simulated(trial, model.only(kept, trial.likelihood.nothing))


def _sensors_first(model: Model, trial: Trial, signatures: Sequence[Signature]) -> Model:
    """Put effects of the sensor in the places of those of the scene that they are as likely as.

    That every surface is painted otherwise than its file tells is less plausible than that the
    sensor exposes otherwise.
    """
    for number, term in enumerate(model.terms):
        if term.candidate.effect.stage is not Stage.SCENE:
            continue
        own, others = _in_place(number, model, trial, signatures)
        least = max(trial.threshold, own.total - _AS_LIKELY)
        likely = [one for one in others if one.total > least and not _of_scene(one)]
        for one in sorted(likely, key=lambda one: -one.total)[:_BEGUN]:
            found = simulated(trial, model.exchanged(number, one))
            if found is not None and found.gain(model, trial.likelihood) > -_AS_LIKELY:
                model = found
                break
    return model


def _of_scene(one: Fit) -> bool:
    return one.signature.candidate.effect.stage is Stage.SCENE


def _in_place(
    number: int, model: Model, trial: Trial, signatures: Sequence[Signature]
) -> tuple[Fit, list[Fit]]:
    """One of the effects, and others in its place, given the rest; beside stand-ins no other is
    simulated closer.
    """
    own, over = _own(number, model, trial)
    given = model.made(without=number)
    # What is made together may explain much without any of them: none is worth a look for that.
    likely = _likely(model.others(signatures), trial, given=given)
    rest = [trial.fit(one.signature, given=given, over=over) for one in likely]
    if not trial.explained(model.made()):
        return own, rest
    signatures = [one.signature for one in rest]
    return own, sharper(signatures, trial, given, over=over, gained=own.total)


def _accepted(number: int, model: Model, trial: Trial, signatures: Sequence[Signature]) -> Accepted:
    """What is told of one of the accepted."""
    own, others = _in_place(number, model, trial, signatures)
    rivals = _rivals(own, others, trial)
    return Accepted(
        fit=own,
        interval=own.interval(trial.rooms, level=_LEVEL),
        rivals=rivals,
        rival_intervals=tuple(one.interval(trial.rooms, level=_LEVEL) for one in rivals),
    )


def _rivals(own: Fit, others: Sequence[Fit], trial: Trial) -> tuple[Fit, ...]:
    """Candidates that gain nearly as much, or about as much room by room.

    As much as an effect has to gain to be named, one has to gain over another to be told from it;
    and a share of all that it gains, as no effect is simulated as it truly is.
    """
    least = (1 if own.total >= trial.threshold else _ENOUGH) * trial.threshold
    margin = max(least, _OF_GAIN * own.total)
    times = draws(trial.rooms, _DRAWS, np.random.default_rng(0))
    found = [
        other
        for other in others
        if other.total > max(0.0, own.total - margin)
        or (other.total > 0 and np.mean(times @ (other.gain - own.gain) >= 0) > _SAME)
    ]
    return tuple(sorted(found, key=lambda one: -one.total))
