"""A case beside what was said of it, and what of that is right."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import permutations

from starling.diagnosis.validation.camera.catalogue import ROWS, Row
from starling.diagnosis.validation.camera.errors import refusal
from starling.diagnosis.validation.camera.nominal import Nominal
from starling.diagnosis.validation.protocol.case import Case
from starling.diagnosis.validation.protocol.verdict import Named, Verdict

_COUNT = {"null": 0, "single": 1, "pair": 2, "unknown": 1}
_SLACK = 1e-9  # Of an interval's ends, which went through text.


@dataclass(frozen=True, kw_only=True, slots=True)
class Answered:
    """A case, the verdict on it, and the number of the set of scenes that both saw."""

    case: Case
    verdict: Verdict
    scenes: int = 0

    def __post_init__(self) -> None:
        count = _COUNT[self.case.kind]
        if len(self.rows) != count:
            rule = f"must have {count} effects as it is of kind {self.case.kind}"
            raise refusal(f"case {self.case.number}", rule, list(self.rows), "Correct the truth.")

    @property
    def rows(self) -> tuple[str, ...]:
        """Effects that were done."""
        return tuple(self.case.settings)

    @property
    def first_right(self) -> bool:
        """Whether the effect named first is one that was done."""
        return self.verdict.said in self.rows

    def family_right(self, families: Mapping[str, str]) -> bool:
        """Whether the effect named first is of the family of one that was done.

        Args:
            families: By effect; one that is not there is a family of its own.
        """
        first, known = self.verdict.first, {families.get(row, row) for row in self.rows}
        return first is not None and families.get(first.row, first.row) in known

    @property
    def in_set(self) -> bool:
        """Whether one that was done is in the set of the effect named first."""
        first = self.verdict.first
        return first is not None and not first.rows.isdisjoint(self.rows)

    @property
    def both_in_sets(self) -> bool:
        """Whether each of two that were done is in the set of a named effect of its own."""
        one, other = self.rows
        pairs = permutations(self.verdict.named, 2)
        return any(one in first.rows and other in second.rows for first, second in pairs)

    @property
    def all_named(self) -> bool:
        """Whether all that were done are named."""
        return {named.row for named in self.verdict.named}.issuperset(self.rows)

    @property
    def unknown(self) -> bool:
        """Whether it was held for an effect that nobody knows."""
        return self.verdict.kind == "none of the known"

    @property
    def alarm(self) -> bool:
        """Whether it was held for a gap."""
        return self.verdict.kind in ("effects", "none of the known")

    def error_pct(self, nominal: Nominal) -> float | None:
        """Error of the strength over the true departure from the neutral [%].

        Departures to opposite sides of the neutral add up. A value that tells nothing of the
        strength, as of another parameter of the effect, errs like the neutral: by 100.

        Returns:
            None unless the effect named first is right and its strength a number.

        Raises:
            WithheldError: if the case's effect is at its neutral.
        """
        measured = self._measured()
        if measured is None:
            return None
        row, first = measured
        true = _signed(row, nominal, self.case.settings[row.name])
        if true == 0:
            name = f"case {self.case.number}"
            raise refusal(name, "must depart from the neutral", row.name, "Make it a null.")
        value = first.value
        if first.name != row.name or isinstance(value, str):
            return 100.0
        if row.scale == "ratio" and value <= 0:
            return 100.0
        return 100.0 * abs(_signed(row, nominal, value) - true) / abs(true)

    def covered(self) -> bool | None:
        """Tell whether the interval holds the true strength; None as of `error_pct`."""
        measured = self._measured()
        if measured is None:
            return None
        row, first = measured
        low, high = first.interval
        if first.name != row.name or isinstance(low, str) or isinstance(high, str):
            return False
        return low - _SLACK <= self.case.settings[row.name] <= high + _SLACK

    def _measured(self) -> tuple[Row, Named] | None:
        first = self.verdict.first
        if first is None or first.row not in self.rows or ROWS[first.row].scale == "choice":
            return None
        return ROWS[first.row], first


def _signed(row: Row, nominal: Nominal, value: float) -> float:
    side = 1.0 if value >= row.neutral_of(nominal) else -1.0
    return side * row.departure(nominal, value)
