"""Effects that act together, fitted and simulated so."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from starling.diagnosis.which.fit import Fit, fit
from starling.diagnosis.which.likelihood import Likelihood
from starling.diagnosis.which.predicted import Made
from starling.diagnosis.which.response import Signature
from starling.diagnosis.which.trial import Trial
from starling.sim.effects.effect import Value

ROUNDS = 3  # Of fitting each effect given the others.


@dataclass(frozen=True, slots=True, eq=False)
class Model:
    """Effects, how strong each is, and what they make of it together."""

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
        """What they make, all or, of all that they make together, what is not one's alone.

        What the others make by themselves lacks that of `beside` which the one has a part in.
        """
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

    def wider(self, by: Fit) -> Model:
        """With one more effect, where it fits."""
        return Model((*self.terms, by.signature), (*self.places, by.place), self.beside)

    def exchanged(self, number: int, by: Fit) -> Model:
        """With another effect in the place of one.

        Args:
            number: of the one.
            by: the other, where it fits.
        """
        terms, at = list(self.terms), list(self.places)
        terms[number], at[number] = by.signature, by.place
        return Model(tuple(terms), tuple(at), self.beside)

    def gain(self, other: Model, likelihood: Likelihood) -> float:
        """Log likelihood by which it explains more than another, of all scenes."""
        return float((likelihood.cost(other.made()) - likelihood.cost(self.made())).sum())


def simulated(trial: Trial, model: Model) -> Model | None:
    """Fit strengths, simulate the effects together, and fit again with what that adds.

    None where they exclude each other in this sensor.

    Args:
        trial: what they are fitted to.
        model: effects, and where to begin.
    """
    model = _fitted(trial.likelihood, model)
    for _ in range(2):
        together = trial.bench.change(model.settings)
        if together is None:
            return None
        alone = Model(model.terms, model.places, trial.likelihood.nothing).made()
        beside = Made(together - alone.change)
        model = _fitted(trial.likelihood, Model(model.terms, model.places, beside))
    return model


def _fitted(likelihood: Likelihood, model: Model) -> Model:
    """Fit each effect given the others, round by round."""
    every = [np.ones(len(likelihood.gap), bool)]
    for _ in range(ROUNDS if len(model.terms) > 1 else 1):
        for number, one in enumerate(model.terms):
            found = fit(one, likelihood, every, given=model.made(without=number))
            moved = (*model.places[:number], found.place, *model.places[number + 1 :])
            model = Model(model.terms, moved, model.beside)
    return model
