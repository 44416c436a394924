"""Search for the effects that explain a gap, by held-out gain and joint simulation.

Effects are added to a model while it gains enough, and removed if held-out scenes do not gain
enough. They are simulated together, and compared with other candidates in their place.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from starling.diagnosis.which.fit import Fit
from starling.diagnosis.which.model import (
    SUFFICIENT_SHARE,
    EffectModel,
    SearchContext,
    fit_and_simulate,
)
from starling.diagnosis.which.response import Signature, add_node
from starling.diagnosis.which.steps import (
    Removal,
    promising_fits,
    prune,
    search_forward,
)
from starling.diagnosis.which.strengths import beyond_range, refine
from starling.diagnosis.which.table import Rows
from starling.sim.effects.effect import Stage, Value

_LEVEL = 0.9  # Confidence level of intervals.
_MARGIN_SHARE = 0.1  # Share of an effect's own gain by which it must exceed a rival.
_WIDENINGS = 2  # Number of times that a range is widened.
EQUAL_COST = 3.0  # Difference of log-likelihoods that is negligible: odds of 20 to 1.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class AcceptedEffect:
    """An effect that explains held-out scenes, and the candidates that could replace it."""

    fit: Fit  # Fit given the other accepted effects.
    interval: tuple[Value, Value]
    rivals: tuple[Fit, ...]  # Candidates that the data cannot distinguish from it in its place.
    rival_intervals: tuple[tuple[Value, Value], ...]
    limited: bool = False  # Whether no value beyond its range is possible, or fits better.

    @property
    def at_end(self) -> bool:
        """Whether a number lies at an end of the values that were tried, and may lie beyond it."""
        tried = self.fit.places
        numeric = self.fit.signature.candidate.numeric
        return numeric and not self.limited and self.fit.place in (tried[0], tried[-1])


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
    model, removals = prune(search_forward(refined, context, signatures), context)
    model, removals, limited = _widen(model, removals, context)
    model, removals = _prefer_sensor(model, removals, context, signatures)
    predicted = model.predict()
    return SearchResult(
        accepted=tuple(
            _describe(
                removal.fit,
                _replacements(number, model, removal, context, signatures),
                context,
                limited=removal.fit.name in limited,
            )
            for number, removal in enumerate(removals)
        ),
        threshold=context.threshold,
        alone=tuple(alone),
        residual=likelihood.residual(predicted),
        unexplained=likelihood.unexplained(predicted),
    )


def _widen(
    model: EffectModel, removals: list[Removal], context: SearchContext
) -> tuple[EffectModel, list[Removal], set[str]]:
    """Try values beyond the range of effects that lie at its end.

    Returns:
        The model, the removal of each of its effects, and the effects for which no value beyond
        their range is possible, or fits better.
    """
    widened, limited = model, set[str]()
    for number in range(len(model.terms)):
        for _ in range(_WIDENINGS):
            term, place = widened.terms[number], widened.places[number]
            value = beyond_range(term, place)
            if value is None:
                break
            extended = add_node(term, value, context.table)
            proposal = None
            if len(extended.values) > len(term.values):
                proposal = fit_and_simulate(context, widened.with_signature(extended, number))
            if proposal is None or proposal.gain_over(widened, context.likelihood) <= 0:
                limited.add(term.name)
                break
            widened = proposal
    if widened is model:
        return model, removals, limited
    return *prune(widened, context), limited


def _prefer_sensor(
    model: EffectModel,
    removals: list[Removal],
    context: SearchContext,
    signatures: Sequence[Signature],
) -> tuple[EffectModel, list[Removal]]:
    """Replace effects of the scene by equally likely effects of the sensor.

    It is less plausible that every surface differs from its description than that, for example, the
    sensor's exposure differs.
    """
    for number, removal in enumerate(removals):
        if not _is_of_scene(removal.fit):
            continue
        least = max(context.threshold, removal.fit.total - EQUAL_COST)
        for fitted in _replacements(number, model, removal, context, signatures):
            if fitted.total <= least or _is_of_scene(fitted):
                continue
            proposal = fit_and_simulate(context, model.with_effect(fitted, instead_of=number))
            if proposal and proposal.gain_over(model, context.likelihood) > -EQUAL_COST:
                pruned = prune(proposal, context)
                return _prefer_sensor(*pruned, context, signatures)
    return model, removals


def _is_of_scene(fitted: Fit) -> bool:
    return fitted.signature.candidate.effect.stage is Stage.SCENE


def _replacements(
    number: int,
    model: EffectModel,
    removal: Removal,
    context: SearchContext,
    signatures: Sequence[Signature],
) -> list[Fit]:
    """Fit the other candidates in the place of one effect."""
    background = model.predict(without=number)
    # The interaction may explain much; a candidate must gain on top of it to be worth refining.
    promising = promising_fits(model.unused(signatures), context, background=background)
    fits = [
        context.fit(fitted.signature, background=background, reference=removal.reference)
        for fitted in promising
    ]
    return refine(
        [fitted.signature for fitted in fits],
        context,
        background,
        reference=removal.reference,
        leader_gain=removal.fit.total,
    )


def _describe(
    current: Fit, replacements: Sequence[Fit], context: SearchContext, *, limited: bool
) -> AcceptedEffect:
    """Describe an effect of the final model: its fit, interval and rivals."""
    rivals = _rivals(current, replacements, context)
    return AcceptedEffect(
        fit=current,
        interval=current.interval(context.rooms, level=_LEVEL),
        rivals=rivals,
        rival_intervals=tuple(rival.interval(context.rooms, level=_LEVEL) for rival in rivals),
        limited=limited,
    )


def _rivals(current: Fit, replacements: Sequence[Fit], context: SearchContext) -> tuple[Fit, ...]:
    """Select candidates that gain nearly as much as an effect.

    To be distinguished from a candidate, an effect must exceed its gain by the threshold. It must
    also exceed it by a share of its own gain, because no effect is simulated exactly.
    """
    accepted = current.total >= context.threshold
    least = (1 if accepted else SUFFICIENT_SHARE) * context.threshold
    margin = max(least, _MARGIN_SHARE * current.total)
    near = [fitted for fitted in replacements if fitted.total > max(0.0, current.total - margin)]
    return tuple(sorted(near, key=lambda fitted: -fitted.total))
