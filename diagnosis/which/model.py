"""Models of several effects that act together, and the data that they are fitted to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from starling.diagnosis.which.fit import Fit, Folds, fit
from starling.diagnosis.which.likelihood import Likelihood, total_size
from starling.diagnosis.which.response import PredictedChange, Signature
from starling.diagnosis.which.table import FeatureTable
from starling.sim.effects.effect import Value

_ROUNDS = 3  # Rounds of fitting each effect given the others.
SUFFICIENT_SHARE = 0.5  # Share of the threshold for one effect that alone explains a gap.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class SearchContext:
    """Data and acceptance thresholds of the search in one segment."""

    table: FeatureTable
    likelihood: Likelihood  # Likelihood of the gap.
    folds: Folds  # Held-out scenes.
    threshold: float  # Least held-out gain of an accepted effect.
    explained_below: float  # Unexplained size below which the gap counts as explained.

    @property
    def rooms(self) -> list[str]:
        """Room of each scene."""
        return [scene.room for scene in self.table.scene_models]

    def fit(
        self,
        signature: Signature,
        *,
        background: PredictedChange | None = None,
        reference: PredictedChange | None = None,
    ) -> Fit:
        """Fit a candidate, and score it on held-out scenes (arguments as `fit.fit`)."""
        return fit(
            signature, self.likelihood, self.folds, background=background, reference=reference
        )

    def is_explained(self, predicted: PredictedChange) -> bool:
        """Whether effects leave no more than correctly named effects usually leave.

        Args:
            predicted: change by the effects.
        """
        unexplained = self.likelihood.unexplained(predicted)
        return total_size(unexplained, self.likelihood.weight) <= self.explained_below

    def least_gain(self, model: EffectModel) -> float:
        """Return the least gain of an effect of a model.

        The threshold separates an effect from no gap. If a gap is evident and one effect explains
        it, the verdict that no known effect explains it would be wrong: less gain suffices.
        """
        sufficient = (
            len(model.terms) == 1
            and self.is_explained(model.predict())
            and not self.is_explained(self.likelihood.no_change)
        )
        return (SUFFICIENT_SHARE if sufficient else 1.0) * self.threshold


@dataclass(frozen=True, slots=True, eq=False)
class EffectModel:
    """Effects with their strengths, and their interaction."""

    terms: tuple[Signature, ...]
    places: tuple[float, ...]  # Strength of each effect, as a position in its signature.
    interaction: PredictedChange  # Simulated joint change less the sum of single changes.

    @property
    def settings(self) -> dict[str, Value]:
        """Value by effect."""
        return {
            term.name: term.value(place)
            for term, place in zip(self.terms, self.places, strict=True)
        }

    def predict(self, *, without: int | None = None) -> PredictedChange:
        """Predict the change by all effects, or by all but one.

        The interaction is included in both cases, also its part due to the omitted effect.
        """
        total = self.interaction
        for number, (term, place) in enumerate(zip(self.terms, self.places, strict=True)):
            if number != without:
                total = total + term.change_at(place)
        return total

    def unused(self, signatures: Sequence[Signature]) -> list[Signature]:
        """Select the signatures of effects that the model does not contain."""
        used = {term.name for term in self.terms}
        return [signature for signature in signatures if signature.name not in used]

    def with_effect(self, addition: Fit, *, instead_of: int | None = None) -> EffectModel:
        """Add an effect at its fitted strength, or put it in the place of another one."""
        number = len(self.terms) if instead_of is None else instead_of
        terms = (*self.terms[:number], addition.signature, *self.terms[number + 1 :])
        places = (*self.places[:number], addition.place, *self.places[number + 1 :])
        return EffectModel(terms, places, self.interaction)

    def with_signature(self, extended: Signature, number: int) -> EffectModel:
        """Replace a signature by one with further values; all strengths stay."""
        values = np.array(extended.values, float)
        value = self.terms[number].value(self.places[number])
        place = float(np.interp(float(value), values, range(len(values))))
        terms = (*self.terms[:number], extended, *self.terms[number + 1 :])
        places = (*self.places[:number], place, *self.places[number + 1 :])
        return EffectModel(terms, places, self.interaction)

    def gain_over(self, reference: EffectModel, likelihood: Likelihood) -> float:
        """Compute the gain in log-likelihood over another model, summed over scenes."""
        difference = likelihood.cost(reference.predict()) - likelihood.cost(self.predict())
        return float(difference.sum())


def fit_and_simulate(context: SearchContext, model: EffectModel) -> EffectModel | None:
    """Fit the strengths, simulate the effects together, and fit again with their interaction.

    Args:
        context: data of the fit.
        model: effects and start values.

    Returns:
        None if the sensor cannot have these effects together.
    """
    model = _fit_strengths(context.likelihood, model)
    for _ in range(2):
        together = context.table.change(model.settings)
        if together is None:
            return None
        single = EffectModel(model.terms, model.places, context.likelihood.no_change).predict()
        interaction = PredictedChange(together - single.change)
        model = _fit_strengths(
            context.likelihood, EffectModel(model.terms, model.places, interaction)
        )
    return model


def without_effect(number: int, model: EffectModel, context: SearchContext) -> EffectModel | None:
    """Remove one effect, and fit and simulate the others again."""
    terms = (*model.terms[:number], *model.terms[number + 1 :])
    places = (*model.places[:number], *model.places[number + 1 :])
    return fit_and_simulate(context, EffectModel(terms, places, context.likelihood.no_change))


def _fit_strengths(likelihood: Likelihood, model: EffectModel) -> EffectModel:
    """Fit each effect given the others, in several rounds."""
    all_scenes = [np.ones(len(likelihood.gap), bool)]
    for _ in range(_ROUNDS if len(model.terms) > 1 else 1):
        for number, term in enumerate(model.terms):
            fitted = fit(term, likelihood, all_scenes, background=model.predict(without=number))
            model = model.with_effect(fitted, instead_of=number)
    return model
