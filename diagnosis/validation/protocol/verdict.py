"""What a diagnosis said of one case, read from the JSON file that it wrote."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypeVar, get_args

from starling.diagnosis.validation.camera.errors import refusal

Kind = Literal["effects", "no gap", "none of the known", "cannot tell"]
Arm = Literal["image", "depth", "whole"]
Value = float | str

_KINDS: tuple[Kind, ...] = get_args(Kind)
_ARMS: tuple[Arm, ...] = get_args(Arm)
_HEADLINE = "features of the "
_ADVICE = "Let the diagnosis write this verdict again."
T = TypeVar("T")


@dataclass(frozen=True, kw_only=True, slots=True)
class Named:
    """An effect that a verdict lists."""

    name: str  # `ROW` or `ROW.PARAMETER`.
    arm: Arm  # What it was found in.
    value: Value
    interval: tuple[Value, Value]
    equals: tuple[str, ...]  # Names not separable from it, its own first.
    gain: float

    @property
    def row(self) -> str:
        """Effect that it is a parameter of."""
        return row_of(self.name)

    @property
    def rows(self) -> frozenset[str]:
        """Effects of its set."""
        return frozenset(map(row_of, self.equals))


@dataclass(frozen=True, kw_only=True, slots=True)
class Verdict:
    """Answer of a diagnosis to one case."""

    kind: Kind
    effects: tuple[Named, ...]  # The largest gain first.
    unexplained: Mapping[Arm, bool]  # Whether an arm has more left than it can explain.
    closed_pct: Mapping[str, float | None]  # By metric; None where nothing can be closed.
    baselines: Mapping[str, str | None]  # What simpler ways would have named,
    baselines_by_arm: Mapping[Arm, Mapping[str, str | None]]  # and of one arm alone.
    seconds: float

    @property
    def named(self) -> tuple[Named, ...]:
        """Effects held to be there: stand-ins for an unknown one are not."""
        return self.effects if self.kind == "effects" else ()

    @property
    def first(self) -> Named | None:
        """Effect named first."""
        return self.named[0] if self.named else None

    @property
    def said(self) -> str:
        """Effect named first, or the verdict that names none."""
        return self.kind if self.first is None else self.first.row

    @property
    def headline_pct(self) -> float | None:
        """Share closed in all that the arm of the effect named first looks at; None without one."""
        return None if self.first is None else self.closed_pct.get(_HEADLINE + self.first.arm)

    def of_arm(self, arm: Arm) -> Verdict:
        """What was said of one arm alone.

        Raises:
            WithheldError: if it was not asked.
        """
        if arm not in self.unexplained:
            raise refusal("arm", f"must be one of {sorted(self.unexplained)}", arm, _ADVICE)
        effects = tuple(one for one in self.effects if one.arm == arm)
        kind: Kind = "effects" if effects else "no gap"
        if self.unexplained[arm]:
            kind = "none of the known"
        simpler = self.baselines_by_arm[arm]
        return dataclasses.replace(self, kind=kind, effects=effects, baselines=simpler)


def row_of(name: str) -> str:
    """Effect of a name `ROW` or `ROW.PARAMETER`."""
    return name.partition(".")[0]


def read(path: Path) -> Verdict:
    """Read the verdict of one case.

    Raises:
        WithheldError: if the file is missing, or holds no verdict.
    """
    try:
        table = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise refusal("verdict", "must be a readable JSON file", path, f"{error}.") from error
    return from_table(table, name=path.name)


def from_table(table: Any, *, name: str = "verdict") -> Verdict:
    """Build a verdict from its JSON; keys unknown here are left aside.

    Args:
        table: What `json.loads` gave.
        name: What refusals call it.

    Raises:
        WithheldError: if a key is missing, of a wrong type, or contradicts another.
    """
    top = _Part(name, table)
    kind: Kind = top.at("verdict").one_of(_KINDS)
    effects = sorted(map(_named, top.at("effects").parts()), key=lambda one: -one.gain)
    if kind == "effects" and not effects:
        raise refusal(f"{name}.effects", "must name one in this verdict", "none", _ADVICE)
    seconds = top.at("seconds").number()
    if seconds < 0:
        raise refusal(f"{name}.seconds", "must be >= 0", seconds, _ADVICE)
    howfar, left = top.at("howfar"), top.at("left")
    by_arm = top.at("baselines_by_arm")
    return Verdict(
        kind=kind,
        effects=tuple(effects),
        unexplained={_Part("arm", arm).one_of(_ARMS): _more(left.at(arm)) for arm in left.table()},
        closed_pct={key: howfar.at(key).at("closed_pct").share() for key in howfar.table()},
        baselines=_simpler(top.at("baselines")),
        baselines_by_arm={
            _Part("arm", arm).one_of(_ARMS): _simpler(by_arm.at(arm)) for arm in left.table()
        },
        seconds=seconds,
    )


def _simpler(part: _Part) -> dict[str, str | None]:
    return {key: part.at(key).text_or_none() for key in part.table()}


def _more(part: _Part) -> bool:
    return part.at("beyond").number() > part.at("below").number()


def _named(part: _Part) -> Named:
    name = part.at("name").text()
    ends = [end.number_or_word() for end in part.at("interval").parts()]
    numbers = [end for end in ends if not isinstance(end, str)]
    if len(ends) != 2 or len(numbers) == 1 or numbers != sorted(numbers):
        rule = "must be two numbers, the lower first, or two words"
        raise refusal(f"{part.where}.interval", rule, ends, _ADVICE)
    equals = tuple(one.text() for one in part.at("set").parts())
    if name not in equals:
        raise refusal(f"{part.where}.set", f"must hold {name} itself", list(equals), _ADVICE)
    return Named(
        name=name,
        arm=part.at("arm").one_of(_ARMS),
        value=part.at("parameters").at(name).number_or_word(),
        interval=(ends[0], ends[1]),
        equals=equals,
        gain=part.at("gain").number(),
    )


@dataclass(frozen=True, slots=True)
class _Part:
    """A value of the file and where it stands."""

    where: str
    value: Any

    def at(self, key: str) -> _Part:
        table = self.table()
        if key not in table:
            raise refusal(self.where, f"must have the key {key}", sorted(table), _ADVICE)
        return _Part(f"{self.where}.{key}", table[key])

    def table(self) -> dict[str, Any]:
        if not isinstance(self.value, dict):
            raise self._not("an object")
        return self.value

    def parts(self) -> list[_Part]:
        if not isinstance(self.value, list):
            raise self._not("a list")
        return [_Part(f"{self.where}[{i}]", one) for i, one in enumerate(self.value)]

    def number(self) -> float:
        real = isinstance(self.value, int | float) and not isinstance(self.value, bool)
        if not real or not math.isfinite(self.value):
            raise self._not("a finite number")
        return float(self.value)

    def text(self) -> str:
        if not isinstance(self.value, str) or not self.value:
            raise self._not("a name")
        return self.value

    def one_of(self, words: tuple[T, ...]) -> T:
        if self.value not in words:
            raise self._not(f"one of {words}")
        return self.value

    def number_or_word(self) -> Value:
        return self.text() if isinstance(self.value, str) else self.number()

    def share(self) -> float | None:
        return None if self.value is None else self.number()

    def text_or_none(self) -> str | None:
        return None if self.value is None else self.text()

    def _not(self, words: str) -> Exception:
        return refusal(self.where, f"must be {words}", repr(self.value), _ADVICE)
