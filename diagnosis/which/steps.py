"""Moves of the search: add an effect to a model, and remove one."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from starling.diagnosis.which.candidates import Candidate
from starling.diagnosis.which.fit import Fit
from starling.diagnosis.which.model import (
    SUFFICIENT_SHARE,
    EffectModel,
    SearchContext,
    fit_and_simulate,
    without_effect,
)
from starling.diagnosis.which.response import PredictedChange, Signature, simulate_signature
from starling.diagnosis.which.strengths import first_nodes, refine, worth_refining

_MOST = 4  # Largest number of effects in a model.
_INTERACTING = 3  # Number of the best candidates that are simulated together with others.


@dataclass(frozen=True, slots=True, eq=False)
class Removal:
    """An effect of a model fitted given the others, and the model without it."""

    fit: Fit  # Its gain counts from a simulation of the others.
    reduced: EffectModel | None  # None if the sensor cannot have the others alone.

    @property
    def reference(self) -> PredictedChange | None:
        """Change by the others alone."""
        return None if self.reduced is None else self.reduced.predict()


def search_forward(
    singles: Sequence[Fit], context: SearchContext, signatures: Sequence[Signature]
) -> EffectModel:
    """Add effects while they gain enough, first to the best one, then to the best pair.

    Alone, an effect can gain most because it imitates two others. A pair is tried only if a gap
    remains. What grows from it has to gain the threshold, for each further effect.

    Args:
        singles: refined candidates, fitted alone, best first.
        context: data of the search.
        signatures: signatures of all candidates.

    Returns:
        A model without effects if nothing gains enough.
    """
    likelihood = context.likelihood
    empty = EffectModel((), (), likelihood.no_change)
    least = SUFFICIENT_SHARE * context.threshold
    models = (empty.with_effect(fitted) for fitted in singles if fitted.total >= least)
    model = grow(accept(models, empty, context) or empty, context, signatures)
    if not model.terms or context.is_explained(model.predict()):
        return model
    pair = _best_pair(singles, empty, context, signatures)
    if pair is None:
        return model
    second = grow(pair, context, signatures)
    further = max(len(second.terms) - len(model.terms), 1)
    least = context.threshold * further
    return second if second.gain_over(model, likelihood) >= least else model


def _best_pair(
    singles: Sequence[Fit],
    empty: EffectModel,
    context: SearchContext,
    signatures: Sequence[Signature],
) -> EffectModel | None:
    """Simulate each leading candidate with its best partner, and return the best pair.

    The partner is chosen as if effects add. Their interaction decides between pairs.
    """
    pairs = []
    for fitted in singles[:_INTERACTING]:
        model = empty.with_effect(fitted)
        partners = promising_fits(model.unused(signatures), context, background=model.predict())
        if partners and partners[0].total >= context.threshold:
            pair = fit_and_simulate(context, model.with_effect(partners[0]))
            pairs += [] if pair is None else [pair]
    return max(pairs, key=lambda pair: pair.gain_over(empty, context.likelihood), default=None)


def grow(
    model: EffectModel, context: SearchContext, signatures: Sequence[Signature]
) -> EffectModel:
    """Add effects to a model while it gains enough.

    Joint simulations are made only if a gap remains. Further parameters come first, because several
    other effects together can imitate one.
    """
    while 0 < len(model.terms) < _MOST:
        explained = context.is_explained(model.predict())
        moves = (_additions,) if explained else (_parameters, _additions, _interactions)
        proposals = (move(model, context, signatures) for move in moves)
        extended = next(filter(None, (accept(each, model, context) for each in proposals)), None)
        if extended is None:
            break
        model = extended
    return model


def accept(
    proposals: Iterable[EffectModel], model: EffectModel, context: SearchContext
) -> EffectModel | None:
    """Simulate the first proposal that the sensor can have; return it if it gains enough.

    The gain of a proposal assumes that effects add, so the simulation may refute it.

    Args:
        proposals: best first.
        model: current model.
        context: data of the search.
    """
    simulated = (fit_and_simulate(context, proposal) for proposal in proposals)
    best = next((proposal for proposal in simulated if proposal is not None), None)
    if best is None or best.gain_over(model, context.likelihood) < context.least_gain(best):
        return None
    return best


def _additions(
    model: EffectModel, context: SearchContext, signatures: Sequence[Signature]
) -> Iterator[EffectModel]:
    """Propose one more effect, best first.

    Candidates are refined again: alone, the best ones resemble the strong effect that the model
    already contains.
    """
    background = model.predict()
    promising = promising_fits(model.unused(signatures), context, background=background)
    for fitted in refine([fitted.signature for fitted in promising], context, background):
        if fitted.total >= context.threshold:
            yield model.with_effect(fitted)


def promising_fits(
    signatures: Sequence[Signature],
    context: SearchContext,
    *,
    background: PredictedChange | None = None,
) -> list[Fit]:
    """Fit candidates together with a background, and select those worth refining."""
    fits = (context.fit(signature, background=background) for signature in signatures)
    return worth_refining(fits, context.threshold)


def _parameters(
    model: EffectModel, context: SearchContext, signatures: Sequence[Signature]
) -> Iterator[EffectModel]:
    """Propose further parameters of accepted effects.

    These do nothing alone: the position of a second projector shows only once it is on.
    """
    accepted = {term.candidate.effect.name for term in model.terms}
    for signature in model.unused(signatures):
        if signature.candidate.effect.name in accepted and not signature.change.any():
            yield from _simulated_jointly(signature.candidate, model, context)


def _interactions(
    model: EffectModel, context: SearchContext, signatures: Sequence[Signature]
) -> Iterator[EffectModel]:
    """Propose the candidates that are best alone, simulated together with the model.

    Two effects can interact strongly, for example a depth limit with hole filling.
    """
    for fitted in promising_fits(model.unused(signatures), context)[:_INTERACTING]:
        if fitted.total >= context.threshold:
            yield from _simulated_jointly(fitted.signature.candidate, model, context)


def _simulated_jointly(
    candidate: Candidate, model: EffectModel, context: SearchContext
) -> Iterator[EffectModel]:
    """Propose a candidate, simulated together with the model, if it gains enough."""
    joint = simulate_signature(
        candidate, context.table, first_nodes(candidate), background=model.settings
    )
    if joint is not None:
        (fitted,) = refine([joint], context, model.predict())
        if fitted.total >= context.threshold:
            yield model.with_effect(fitted)


def prune(model: EffectModel, context: SearchContext) -> tuple[EffectModel, list[Removal]]:
    """Remove effects whose held-out gain, simulated with the others, is not sufficient.

    Returns:
        The model, and the removal of each of its effects.
    """
    while True:
        removals = [_remove(number, model, context) for number in range(len(model.terms))]
        worst = min(removals, key=lambda removal: removal.fit.total, default=None)
        least = context.least_gain(model)
        if worst is None or worst.reduced is None or worst.fit.total >= least:
            return model, removals
        model = worst.reduced


def _remove(number: int, model: EffectModel, context: SearchContext) -> Removal:
    reduced = without_effect(number, model, context)
    fitted = context.fit(
        model.terms[number],
        background=model.predict(without=number),
        reference=None if reduced is None else reduced.predict(),
    )
    return Removal(fitted, reduced)
