"""Verdict of a diagnosis on one case, read from its JSON file, and its correctness."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import permutations
from pathlib import Path
from typing import Any, Literal, TypeVar, get_args

from starling.diagnosis.validation.camera import json_file
from starling.diagnosis.validation.camera.catalogue import ROWS, EffectRow
from starling.diagnosis.validation.camera.errors import refusal
from starling.diagnosis.validation.camera.imperfections import IMPERFECTIONS
from starling.diagnosis.validation.camera.nominal import Nominal
from starling.diagnosis.validation.protocol.case import Case

Kind = Literal["effects", "no gap", "none of the known", "cannot tell"]
SegmentName = Literal["image", "depth", "whole"]
Value = float | str

_KINDS: tuple[Kind, ...] = get_args(Kind)
_SEGMENTS: tuple[SegmentName, ...] = get_args(SegmentName)
_HEADLINE = "features of the "
_SLACK = 1e-9  # Tolerance of interval ends, which are rounded by the JSON text.
_ADVICE = "Run the diagnosis of this case again."
T = TypeVar("T")


@dataclass(frozen=True, kw_only=True, slots=True)
class NamedEffect:
    """An effect that a verdict lists."""

    name: str  # `ROW` or `ROW.PARAMETER`.
    segment: SegmentName  # Pipeline segment whose features identify the effect.
    value: Value
    interval: tuple[Value, Value]
    credible_set: tuple[str, ...]  # Equivalent candidates, including `name`.
    gain: float  # Held-out log-likelihood gain.
    surrogate: bool = False  # Whether the diagnosis calls it a surrogate.

    @property
    def row(self) -> str:
        """Effect that the parameter belongs to."""
        return row_of(self.name)

    @property
    def rows(self) -> frozenset[str]:
        """Effects of the credible set."""
        return frozenset(map(row_of, self.credible_set))


@dataclass(frozen=True, kw_only=True, slots=True)
class Verdict:
    """Verdict of a diagnosis on one case."""

    kind: Kind
    effects: tuple[NamedEffect, ...]  # In descending order of gain.
    unexplained: Mapping[SegmentName, bool]  # Whether a segment has an unexplained residual.
    closed_pct: Mapping[str, float | None]  # Gap reduction by metric; None if unidentifiable.
    baselines: Mapping[str, str | None]  # Effect that each baseline method names.
    baselines_by_segment: Mapping[SegmentName, Mapping[str, str | None]]
    seconds: float

    @property
    def named(self) -> tuple[NamedEffect, ...]:
        """Named effects: those that are no surrogates."""
        if self.kind != "effects":
            return ()
        return tuple(effect for effect in self.effects if not effect.surrogate)

    @property
    def top_effect(self) -> NamedEffect | None:
        """Top-1 effect: the named effect of the largest gain."""
        return self.named[0] if self.named else None

    @property
    def answer(self) -> str:
        """Top-1 effect, or the kind of a verdict that names none."""
        return self.kind if self.top_effect is None else self.top_effect.row

    @property
    def headline_pct(self) -> float | None:
        """Gap reduction [%] over all features of the segment of the top-1 effect, None if none."""
        top = self.top_effect
        return None if top is None else self.closed_pct.get(_HEADLINE + top.segment)

    @property
    def leaves_gap(self) -> bool:
        """Whether it reports a gap that no known effect explains, with or without named effects."""
        return self.kind == "none of the known" or any(self.unexplained.values())

    def restricted_to(self, segment: SegmentName) -> Verdict:
        """Return the verdict on one pipeline segment alone.

        Raises:
            WithheldError: if the diagnosis did not examine the segment.
        """
        if segment not in self.unexplained:
            raise refusal("arm", f"must be one of {sorted(self.unexplained)}", segment, _ADVICE)
        effects = tuple(effect for effect in self.effects if effect.segment == segment)
        kind: Kind = "none of the known" if effects or self.unexplained[segment] else "no gap"
        if any(not effect.surrogate for effect in effects):
            kind = "effects"
        baselines = self.baselines_by_segment[segment]
        return dataclasses.replace(self, kind=kind, effects=effects, baselines=baselines)


@dataclass(frozen=True, kw_only=True, slots=True)
class CaseResult:
    """A case, the verdict on it, and the number of its scene set."""

    case: Case
    verdict: Verdict
    set_number: int = 0

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
    def wrong_named(self) -> bool:
        """Whether an effect is named that neither the case nor its imperfections have."""
        named = {effect.row for effect in self.verdict.named}
        return not named.issubset({*self.rows, *self.world_rows})

    @property
    def world_rows(self) -> frozenset[str]:
        """Effects that truly name an imperfection of the base."""
        imperfections = map(IMPERFECTIONS.__getitem__, self.case.imperfections)
        return frozenset(row for each in imperfections for row in each.rows)

    @property
    def listed_first(self) -> bool:
        """Whether a true effect has the largest gain, be it named or called a surrogate."""
        listed = self.verdict.effects
        return bool(listed) and listed[0].row in self.rows

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
        """
        estimate = self._strength_estimate()
        if estimate is None:
            return None
        row, effect = estimate
        true = _signed(row, nominal, self.case.settings[row.name])
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


def row_of(name: str) -> str:
    """Return the effect of a name `ROW` or `ROW.PARAMETER`."""
    return name.partition(".")[0]


def read(path: Path) -> Verdict:
    """Read the verdict of one case.

    Raises:
        WithheldError: if the file is missing or holds no verdict.
    """
    return from_table(json_file.read(path, "verdict"), name=path.name)


def from_table(table: Any, *, name: str = "verdict") -> Verdict:
    """Build a verdict from its JSON. Unknown keys are ignored.

    Args:
        table: Result of `json.loads`.
        name: Name of the verdict in error messages.

    Raises:
        WithheldError: if a key is missing, has a wrong type, or contradicts another key.
    """
    top = _JsonValue(name, table)
    kind: Kind = top.get("verdict").one_of(_KINDS)
    effects = sorted(map(_named, top.get("effects").elements()), key=lambda effect: -effect.gain)
    if kind == "effects" and all(effect.surrogate for effect in effects):
        raise refusal(f"{name}.effects", "must name one in this verdict", "none", _ADVICE)
    seconds = top.get("seconds").number()
    if seconds < 0:
        raise refusal(f"{name}.seconds", "must be >= 0", seconds, _ADVICE)
    howfar, residual = top.get("howfar"), top.get("left")
    by_segment = top.get("baselines_by_arm")
    segments: list[SegmentName] = [
        _JsonValue("arm", segment).one_of(_SEGMENTS) for segment in residual.table()
    ]
    return Verdict(
        kind=kind,
        effects=tuple(effects),
        unexplained={segment: _is_unexplained(residual.get(segment)) for segment in segments},
        closed_pct={
            key: howfar.get(key).get("closed_pct").number_or_none() for key in howfar.table()
        },
        baselines=_baselines(top.get("baselines")),
        baselines_by_segment={segment: _baselines(by_segment.get(segment)) for segment in segments},
        seconds=seconds,
    )


def _baselines(entry: _JsonValue) -> dict[str, str | None]:
    return {key: entry.get(key).text_or_none() for key in entry.table()}


def _is_unexplained(entry: _JsonValue) -> bool:
    return entry.get("beyond").number() > entry.get("below").number()


def _named(entry: _JsonValue) -> NamedEffect:
    name = entry.get("name").text()
    ends = [end.number_or_word() for end in entry.get("interval").elements()]
    numbers = [end for end in ends if not isinstance(end, str)]
    if len(ends) != 2 or len(numbers) == 1 or numbers != sorted(numbers):
        rule = "must be two numbers, the lower first, or two words"
        raise refusal(f"{entry.path}.interval", rule, ends, _ADVICE)
    credible_set = tuple(item.text() for item in entry.get("set").elements())
    if name not in credible_set:
        raise refusal(f"{entry.path}.set", f"must hold {name} itself", list(credible_set), _ADVICE)
    return NamedEffect(
        name=name,
        segment=entry.get("arm").one_of(_SEGMENTS),
        value=entry.get("parameters").get(name).number_or_word(),
        interval=(ends[0], ends[1]),
        credible_set=credible_set,
        gain=entry.get("gain").number(),
        surrogate=entry.get("stand_in").truth(),
    )


@dataclass(frozen=True, slots=True)
class _JsonValue:
    """A value of the file and its path of keys."""

    path: str
    value: Any

    def get(self, key: str) -> _JsonValue:
        table = self.table()
        if key not in table:
            raise refusal(self.path, f"must have the key {key}", sorted(table), _ADVICE)
        return _JsonValue(f"{self.path}.{key}", table[key])

    def table(self) -> dict[str, Any]:
        if not isinstance(self.value, dict):
            raise self._type_error("an object")
        return self.value

    def elements(self) -> list[_JsonValue]:
        if not isinstance(self.value, list):
            raise self._type_error("a list")
        return [_JsonValue(f"{self.path}[{i}]", item) for i, item in enumerate(self.value)]

    def number(self) -> float:
        real = isinstance(self.value, int | float) and not isinstance(self.value, bool)
        if not real or not math.isfinite(self.value):
            raise self._type_error("a finite number")
        return float(self.value)

    def truth(self) -> bool:
        if not isinstance(self.value, bool):
            raise self._type_error("true or false")
        return self.value

    def text(self) -> str:
        if not isinstance(self.value, str) or not self.value:
            raise self._type_error("a name")
        return self.value

    def one_of(self, words: tuple[T, ...]) -> T:
        if self.value not in words:
            raise self._type_error(f"one of {words}")
        return self.value

    def number_or_word(self) -> Value:
        return self.text() if isinstance(self.value, str) else self.number()

    def number_or_none(self) -> float | None:
        return None if self.value is None else self.number()

    def text_or_none(self) -> str | None:
        return None if self.value is None else self.text()

    def _type_error(self, words: str) -> Exception:
        return refusal(self.path, f"must be {words}", repr(self.value), _ADVICE)
