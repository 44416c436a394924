"""What effects are tried on: scenes with a gap, and how much one has to gain to be named."""

from __future__ import annotations

from dataclasses import dataclass

from starling.diagnosis.which.fit import Fit, Folds, fit
from starling.diagnosis.which.likelihood import Likelihood, total
from starling.diagnosis.which.predicted import Made
from starling.diagnosis.which.response import Signature
from starling.diagnosis.which.table import Bench


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Trial:
    """One arm's."""

    bench: Bench
    likelihood: Likelihood  # Of the gap.
    folds: Folds  # Scenes held out.
    threshold: float  # Least gain of an effect.
    explained_below: float  # Size of what is left up to which nothing else is looked for.

    @property
    def rooms(self) -> list[str]:
        """That of each scene."""
        return [one.room for one in self.bench.subjects]

    def fit(
        self, signature: Signature, *, given: Made | None = None, over: Made | None = None
    ) -> Fit:
        """Fit a candidate and judge it on scenes held out.

        Args:
            signature: of the candidate.
            given: what other effects make beside it; None where there are none.
            over: what they make without it, which the gain is over; None where that is the same.
        """
        return fit(signature, self.likelihood, self.folds, given=given, over=over)

    def explained(self, made: Made) -> bool:
        """Whether no more is left than effects leave that are named rightly.

        Args:
            made: what effects make.
        """
        beyond = total(self.likelihood.beyond(made), self.likelihood.weight)
        return beyond <= self.explained_below
