"""Search for the effects that explain a gap, by held-out gain and joint simulation.

Effects are added to a model while held-out scenes gain. Accepted effects are simulated together,
and compared with other candidates in their place.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from starling.diagnosis.scenes.rooms import resample_rooms
from starling.diagnosis.which.fit import Fit
from starling.diagnosis.which.model import EffectModel, SearchContext, fit_and_simulate
from starling.diagnosis.which.response import PredictedChange, Signature
from starling.diagnosis.which.steps import (
    ATTEMPTS,
    SUFFICIENT_SHARE,
    add_parameters,
    exchange,
    grow,
    is_sufficient,
    promising_fits,
    prune,
    start,
    without_effect,
)
from starling.diagnosis.which.strengths import refine
from starling.diagnosis.which.table import Rows
from starling.sim.effects.effect import Stage, Value

_LEVEL = 0.9  # Confidence level of intervals.
_DRAWS = 400  # Bootstrap resamples of rooms.
_MARGIN_SHARE = 0.1  # Share of an effect's own gain by which it must exceed a rival.
_EQUAL_COST = 3.0  # Difference of log-likelihoods that is negligible: odds of 20 to 1.
_RIVAL_PROBABILITY = 0.05  # Probability that a candidate is as good, from which it is a rival.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class AcceptedEffect:
    """An effect that explains held-out scenes, and the candidates that could replace it."""

    fit: Fit  # Fit given the other accepted effects.
    interval: tuple[Value, Value]
    rivals: tuple[Fit, ...]  # Candidates that the data cannot distinguish from it in its place.
    rival_intervals: tuple[tuple[Value, Value], ...]


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class SearchResult:
    """Result of the search in one segment."""

    accepted: tuple[AcceptedEffect, ...]
    threshold: float
    alone: tuple[Fit, ...]  # All candidates fitted alone, best first.
    residual: Rows = field(repr=False)  # (scenes, features) remaining gap over its deviation.
    unexplained: Rows = field(repr=False)  # The same, after the effects' model error.

    @property
    def settings(self) -> dict[str, Value]:
        """Value by accepted effect."""
        return {effect.fit.name: effect.fit.value for effect in self.accepted}


def search_effects(
    context: SearchContext, promising: Sequence[Fit], alone: Sequence[Fit]
) -> SearchResult:
    """Search for effects that explain the gap.

    Args:
        context: data of the search.
        promising: candidates that are refined, fitted alone at their first nodes.
        alone: all candidates fitted alone, best first.
    """
    likelihood = context.likelihood
    refined = refine([fitted.signature for fitted in promising], context, likelihood.no_change)
    known = {fitted.name for fitted in refined}
    rest = [fitted for fitted in alone if fitted.name not in known]
    signatures = [fitted.signature for fitted in (*refined, *rest)]
    model = grow(start(refined, context, alone), context, signatures)
    if not context.is_explained(model.predict()):
        exchanged = exchange(model, context, signatures)
        if exchanged is not model:
            model = grow(exchanged, context, signatures)
    if not context.is_explained(model.predict()):
        completed = add_parameters(model, context, alone)
        if completed is not model:
            model = prune(completed, context)
    model = _prefer_sensor(_prune_held_out(model, context), context, signatures)
    return SearchResult(
        accepted=tuple(
            _accept(number, model, context, signatures) for number in range(len(model.terms))
        ),
        threshold=context.threshold,
        alone=tuple(alone),
        residual=likelihood.residual(model.predict()),
        unexplained=likelihood.unexplained(model.predict()),
    )


def _prune_held_out(model: EffectModel, context: SearchContext) -> EffectModel:
    """Remove effects whose held-out gain, simulated with the others, is no longer sufficient."""
    while model.terms:
        sufficient = is_sufficient(model, context)
        least = (SUFFICIENT_SHARE if sufficient else 1) * context.threshold
        gains = [_refit(number, model, context)[0].total for number in range(len(model.terms))]
        worst = int(np.argmin(gains))
        if gains[worst] >= least or (reduced := without_effect(worst, model, context)) is None:
            break
        model = reduced
    return model


def _refit(
    number: int, model: EffectModel, context: SearchContext
) -> tuple[Fit, PredictedChange | None]:
    """Fit one effect given the others; its gain counts from a simulation without it.

    Also return the change without it; None if the sensor cannot have the others alone.
    """
    reduced = without_effect(number, model, context)
    reference = None if reduced is None else reduced.predict()
    background = model.predict(without=number)
    fitted = context.fit(model.terms[number], background=background, reference=reference)
    return fitted, reference


def _prefer_sensor(
    model: EffectModel, context: SearchContext, signatures: Sequence[Signature]
) -> EffectModel:
    """Replace effects of the scene by equally likely effects of the sensor.

    It is less plausible that every surface differs from its description than that, for example, the
    sensor's exposure differs.
    """
    for number, term in enumerate(model.terms):
        if term.candidate.effect.stage is not Stage.SCENE:
            continue
        current, replacements = _replacements(number, model, context, signatures)
        least = max(context.threshold, current.total - _EQUAL_COST)
        likely = [
            fitted for fitted in replacements if fitted.total > least and not _is_of_scene(fitted)
        ]
        for fitted in sorted(likely, key=lambda fitted: -fitted.total)[:ATTEMPTS]:
            proposal = fit_and_simulate(context, model.exchanged(number, fitted))
            if proposal is not None:
                gain = proposal.gain_over(model, context.likelihood)
                if gain > -_EQUAL_COST:
                    model = proposal
                    break
    return model


def _is_of_scene(fitted: Fit) -> bool:
    return fitted.signature.candidate.effect.stage is Stage.SCENE


def _replacements(
    number: int, model: EffectModel, context: SearchContext, signatures: Sequence[Signature]
) -> tuple[Fit, list[Fit]]:
    """Fit one effect of the model, and the other candidates in its place.

    The candidates are refined only if the model explains the gap: a surrogate needs no exact rival.
    """
    current, reference = _refit(number, model, context)
    background = model.predict(without=number)
    # The interaction may explain much; a candidate must gain on top of it to be worth refining.
    promising = promising_fits(model.unused(signatures), context, background=background)
    fits = [
        context.fit(fitted.signature, background=background, reference=reference)
        for fitted in promising
    ]
    if not context.is_explained(model.predict()):
        return current, fits
    signatures = [fitted.signature for fitted in fits]
    leader_gain = current.total
    return current, refine(
        signatures, context, background, reference=reference, leader_gain=leader_gain
    )


def _accept(
    number: int, model: EffectModel, context: SearchContext, signatures: Sequence[Signature]
) -> AcceptedEffect:
    """Describe an effect of the final model: its fit, interval and rivals."""
    current, replacements = _replacements(number, model, context, signatures)
    rivals = _rivals(current, replacements, context)
    return AcceptedEffect(
        fit=current,
        interval=current.interval(context.rooms, level=_LEVEL),
        rivals=rivals,
        rival_intervals=tuple(rival.interval(context.rooms, level=_LEVEL) for rival in rivals),
    )


def _rivals(current: Fit, replacements: Sequence[Fit], context: SearchContext) -> tuple[Fit, ...]:
    """Select candidates that gain nearly as much as an effect, or as much within the scatter.

    To be distinguished from a candidate, an effect must exceed its gain by the threshold. It must
    also exceed it by a share of its own gain, because no effect is simulated exactly.
    """
    accepted = current.total >= context.threshold
    least = (1 if accepted else SUFFICIENT_SHARE) * context.threshold
    margin = max(least, _MARGIN_SHARE * current.total)
    times = resample_rooms(context.rooms, _DRAWS, np.random.default_rng(0))
    rivals = [
        fitted
        for fitted in replacements
        if fitted.total > max(0.0, current.total - margin)
        or (
            fitted.total > 0
            and np.mean(times @ (fitted.gain - current.gain) >= 0) > _RIVAL_PROBABILITY
        )
    ]
    return tuple(sorted(rivals, key=lambda fitted: -fitted.total))
