"""A case with its verdict, and the correctness of the verdict."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import permutations

from starling.diagnosis.validation.camera.catalogue import ROWS, EffectRow
from starling.diagnosis.validation.camera.errors import refusal
from starling.diagnosis.validation.camera.nominal import Nominal
from starling.diagnosis.validation.protocol.case import Case
from starling.diagnosis.validation.protocol.verdict import NamedEffect, Verdict

_COUNT = {"null": 0, "single": 1, "pair": 2, "unknown": 1}
_SLACK = 1e-9  # Tolerance of interval ends, which are rounded by the JSON text.


@dataclass(frozen=True, kw_only=True, slots=True)
class CaseResult:
    """A case, the verdict on it, and the number of its scene set."""

    case: Case
    verdict: Verdict
    set_number: int = 0

    def __post_init__(self) -> None:
        count = _COUNT[self.case.kind]
        if len(self.rows) != count:
            rule = f"must have {count} effects, as its kind is {self.case.kind}"
            raise refusal(f"case {self.case.number}", rule, list(self.rows), "Correct the truth.")

    @property
    def rows(self) -> tuple[str, ...]:
        """True effects of the case."""
        return tuple(self.case.settings)

    @property
    def top1_correct(self) -> bool:
        """Whether the top-1 effect is a true effect."""
        return self.verdict.answer in self.rows

    def top1_family_correct(self, families: Mapping[str, str]) -> bool:
        """Return whether the top-1 effect belongs to the family of a true effect.

        Args:
            families: Family by effect. An effect without an entry is a family of its own.
        """
        top, true_families = self.verdict.top_effect, {families.get(row, row) for row in self.rows}
        return top is not None and families.get(top.row, top.row) in true_families

    @property
    def in_set(self) -> bool:
        """Whether a true effect is in the credible set of the top-1 effect."""
        top = self.verdict.top_effect
        return top is not None and not top.rows.isdisjoint(self.rows)

    @property
    def both_in_sets(self) -> bool:
        """Whether both true effects are in the credible sets of two different named effects."""
        row_a, row_b = self.rows
        pairs = permutations(self.verdict.named, 2)
        return any(row_a in first.rows and row_b in second.rows for first, second in pairs)

    @property
    def all_named(self) -> bool:
        """Whether all true effects are named."""
        return {named.row for named in self.verdict.named}.issuperset(self.rows)

    @property
    def declared_unknown(self) -> bool:
        """Whether the verdict is an unknown effect."""
        return self.verdict.kind == "none of the known"

    @property
    def gap_reported(self) -> bool:
        """Whether the verdict reports a gap."""
        return self.verdict.kind in ("effects", "none of the known")

    def error_pct(self, nominal: Nominal) -> float | None:
        """Return the error of the estimated strength over the true departure from the neutral [%].

        Departures on opposite sides of the neutral add up. A verdict that does not estimate the
        strength, for example one of another parameter of the effect, has an error of 100 %.

        Returns:
            The error, or None unless the top-1 effect is correct and its strength is a number.

        Raises:
            WithheldError: if the effect of the case is at its neutral.
        """
        estimate = self._strength_estimate()
        if estimate is None:
            return None
        row, effect = estimate
        true = _signed(row, nominal, self.case.settings[row.name])
        if true == 0:
            name = f"case {self.case.number}"
            raise refusal(name, "must depart from the neutral", row.name, "Make it a null.")
        value = effect.value
        if effect.name != row.name or isinstance(value, str):
            return 100.0
        if row.scale == "ratio" and value <= 0:
            return 100.0
        return 100.0 * abs(_signed(row, nominal, value) - true) / abs(true)

    def interval_covers_truth(self) -> bool | None:
        """Return whether the interval contains the true strength; None as for `error_pct`."""
        estimate = self._strength_estimate()
        if estimate is None:
            return None
        row, effect = estimate
        low, high = effect.interval
        if effect.name != row.name or isinstance(low, str) or isinstance(high, str):
            return False
        return low - _SLACK <= self.case.settings[row.name] <= high + _SLACK

    def _strength_estimate(self) -> tuple[EffectRow, NamedEffect] | None:
        top = self.verdict.top_effect
        if top is None or top.row not in self.rows or ROWS[top.row].scale == "choice":
            return None
        return ROWS[top.row], top


def _signed(row: EffectRow, nominal: Nominal, value: float) -> float:
    side = 1.0 if value >= row.neutral_of(nominal) else -1.0
    return side * row.departure(nominal, value)
