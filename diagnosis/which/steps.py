"""Steps of the search: start, extend, exchange and prune a model of effects."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence

import numpy as np

from starling.diagnosis.which.candidates import Candidate
from starling.diagnosis.which.fit import Fit, held_out_gain, places
from starling.diagnosis.which.model import (
    ROUNDS,
    EffectModel,
    SearchContext,
    fit_and_simulate,
)
from starling.diagnosis.which.response import (
    PredictedChange,
    Signature,
    simulate_signature,
    stack_changes,
)
from starling.diagnosis.which.strengths import first_nodes, refine, worth_refining

MOST = 4  # Largest number of effects in a model.
ATTEMPTS = 3  # Largest number of joint simulations before the next step.
SUFFICIENT_SHARE = 0.5  # Share of the threshold for one effect that alone explains a gap.
_PAIRED = 8  # Number of best candidates among which pairs are tried.
_PAIR_STEPS = 4  # Positions between two nodes at which pairs are tried.


def start(refined: Sequence[Fit], context: SearchContext, alone: Sequence[Fit]) -> EffectModel:
    """Start with the best single effect, or with a pair that gains enough over it.

    The sum of two strong effects is not their joint change. A sum may surpass the one effect that
    acts, which the joint simulation then refutes. A pair may also imitate a parameter that does
    nothing alone, such as the position of a second projector; such parameters are tried first.
    """
    empty = EffectModel((), (), context.likelihood.no_change)
    if not refined or refined[0].total < context.threshold:
        return _sufficient(refined, context)
    singles = [empty.extended(fitted) for fitted in refined if fitted.total >= context.threshold]
    single = _first(fit_and_simulate(context, model) for model in singles[:ATTEMPTS]) or empty
    if not context.is_explained(single.predict()):
        single = add_parameters(single, context, alone)
    pairs = _pairs(refined, context)[:ATTEMPTS]
    return _first(_if_better(pair, single, context) for pair in pairs) or single


def _first(models: Iterable[EffectModel | None]) -> EffectModel | None:
    """Return the first model that is not None; later ones are not computed."""
    return next((model for model in models if model is not None), None)


def _sufficient(refined: Sequence[Fit], context: SearchContext) -> EffectModel:
    """Find a single effect below the threshold that explains the whole gap, or return no effect.

    The threshold separates an effect from no gap. If a gap is evident and one effect explains it,
    the verdict that no known effect explains it would be wrong.
    """
    empty = EffectModel((), (), context.likelihood.no_change)
    for fitted in refined:
        if fitted.total < SUFFICIENT_SHARE * context.threshold:
            break
        single = fit_and_simulate(context, empty.extended(fitted))
        if single is not None and is_sufficient(single, context):
            return single
    return empty


def is_sufficient(model: EffectModel, context: SearchContext) -> bool:
    """Whether there is a gap, and the model is a single effect that explains all of it."""
    gap = not context.is_explained(context.likelihood.no_change)
    return gap and len(model.terms) == 1 and context.is_explained(model.predict())


def _pairs(refined: Sequence[Fit], context: SearchContext) -> list[EffectModel]:
    """List pairs whose sum exceeds the best single effect by the threshold, best first."""
    best, no_change = refined[0], context.likelihood.no_change
    pairs: list[tuple[float, EffectModel]] = []
    for first, second in itertools.combinations(refined[:_PAIRED], 2):
        gain, best_places = _fit_pair(first.signature, second.signature, context)
        if gain > best.total + context.threshold:
            signatures = (first.signature, second.signature)
            pairs.append((gain, EffectModel(signatures, best_places, no_change)))
    return [model for _, model in sorted(pairs, key=lambda pair: -pair[0])]


def _fit_pair(
    first: Signature, second: Signature, context: SearchContext
) -> tuple[float, tuple[float, float]]:
    """Fit the sum of two effects on a grid; return its held-out gain and the best positions."""
    likelihood = context.likelihood
    grids = [places(signature, _PAIR_STEPS) for signature in (first, second)]
    positions = list(itertools.product(*grids))
    cost = likelihood.cost(
        stack_changes([first.change_at(a) + second.change_at(b) for a, b in positions])
    )
    gain = held_out_gain(cost, likelihood.cost(likelihood.no_change), context.folds)
    return float(gain.sum()), positions[int(np.argmin(cost.sum(axis=1)))]


def grow(
    model: EffectModel, context: SearchContext, signatures: Sequence[Signature]
) -> EffectModel:
    """Add effects while they gain enough, and prune those that become redundant."""
    while model.terms and len(model.terms) < MOST:
        extended = _extend(model, context, signatures)
        if extended is None:
            break
        model = extended
    return prune(model, context)


def _extend(
    model: EffectModel, context: SearchContext, signatures: Sequence[Signature]
) -> EffectModel | None:
    """Add the effect with the largest sufficient gain given the model, confirmed by simulation.

    Candidates are refined again: alone, the best ones resemble the strong effect that the model
    already contains. If none suffices and much is unexplained, the candidates that are best alone
    are simulated jointly with the model. Two effects can interact strongly, for example a depth
    limit with hole filling.
    """
    background, unused = model.predict(), model.unused(signatures)
    promising = promising_fits(unused, context, background=background)
    refined = refine([fitted.signature for fitted in promising], context, background)
    sufficient = (fitted for fitted in refined if fitted.total >= context.threshold)
    extended = _first(_if_better(model.extended(fitted), model, context) for fitted in sufficient)
    if extended is not None or context.is_explained(background):
        return extended
    best_alone = promising_fits(unused, context)[:ATTEMPTS]
    candidates = (
        fitted.signature.candidate for fitted in best_alone if fitted.total >= context.threshold
    )
    return _first(_add_jointly(candidate, model, context) for candidate in candidates)


def promising_fits(
    signatures: Sequence[Signature],
    context: SearchContext,
    *,
    background: PredictedChange | None = None,
) -> list[Fit]:
    """Fit candidates together with a background, and select those worth refining."""
    fits = (context.fit(signature, background=background) for signature in signatures)
    return worth_refining(fits, context.threshold)


def _add_jointly(
    candidate: Candidate, model: EffectModel, context: SearchContext
) -> EffectModel | None:
    """Add an effect by its signature simulated jointly with the model, if it gains enough."""
    joint = simulate_signature(
        candidate, context.table, first_nodes(candidate), background=model.settings
    )
    if joint is None:
        return None
    (best,) = refine([joint], context, model.predict())
    if best.total < context.threshold:
        return None
    return _if_better(model.extended(best), model, context)


def _if_better(
    proposal: EffectModel, model: EffectModel, context: SearchContext
) -> EffectModel | None:
    """Simulate a proposal; return it if it gains enough over the current model."""
    simulated = fit_and_simulate(context, proposal)
    if simulated is None or simulated.gain_over(model, context.likelihood) < context.threshold:
        return None
    return simulated


def exchange(
    model: EffectModel, context: SearchContext, signatures: Sequence[Signature]
) -> EffectModel:
    """Replace effects by candidates that gain enough more in their place.

    The first effect may be a compromise between two effects. This shows once one of them is in the
    model.
    """
    for _ in range(ROUNDS):
        unused = model.unused(signatures)
        proposals: list[tuple[float, EffectModel]] = []
        for number, term in enumerate(model.terms):
            background = model.predict(without=number)
            current = context.fit(term, background=background).total
            fits = (context.fit(signature, background=background) for signature in unused)
            proposals += [
                (fitted.total - current, model.exchanged(number, fitted)) for fitted in fits
            ]
        sufficient = [proposal for proposal in proposals if proposal[0] >= context.threshold]
        best = sorted(sufficient, key=lambda proposal: -proposal[0])[:ATTEMPTS]
        exchanged = _first(_if_better(proposal, model, context) for _, proposal in best)
        if exchanged is None:
            break
        model = exchanged
    return model


def add_parameters(model: EffectModel, context: SearchContext, alone: Sequence[Fit]) -> EffectModel:
    """Add further parameters of accepted effects, if they gain enough.

    These do nothing alone: the position of a second projector shows only once it is on.
    """
    idle = [fitted.signature.candidate for fitted in alone if not fitted.signature.change.any()]
    accepted = {term.candidate.effect.name for term in model.terms}
    for candidate in (candidate for candidate in idle if candidate.effect.name in accepted):
        if candidate.name not in model.settings:
            model = _add_jointly(candidate, model, context) or model
    return model


def prune(model: EffectModel, context: SearchContext) -> EffectModel:
    """Remove effects fitted to their base value, and effects that the others can replace."""
    while len(acting := _acting(model)) < len(model.terms):
        reduced = model.subset(acting, context.likelihood.no_change)
        model = fit_and_simulate(context, reduced) or reduced
    for number in reversed(range(len(model.terms))):
        if len(model.terms) < 2:
            break
        reduced = without_effect(number, model, context)
        if reduced is not None:
            gain = model.gain_over(reduced, context.likelihood)
            model = reduced if gain < context.threshold else model
    return model


def _acting(model: EffectModel) -> list[int]:
    """List the effects that are not at their base value."""
    values = model.settings
    return [n for n, term in enumerate(model.terms) if values[term.name] != term.candidate.base]


def without_effect(number: int, model: EffectModel, context: SearchContext) -> EffectModel | None:
    """Remove one effect, and fit and simulate the others again."""
    remaining = [n for n in range(len(model.terms)) if n != number]
    return fit_and_simulate(context, model.subset(remaining, context.likelihood.no_change))
