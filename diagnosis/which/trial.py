"""What effects are tried on: scenes with a gap, and how much one has to gain to be named."""

from __future__ import annotations

from dataclasses import dataclass

from diagnosis.which.bench import Bench
from diagnosis.which.fit import Fit, Folds, fit
from diagnosis.which.likelihood import Likelihood, total
from diagnosis.which.made import Made
from diagnosis.which.signature import Signature


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
