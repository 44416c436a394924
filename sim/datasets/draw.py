"""Values that a plan leaves open, and how they are drawn."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from starling.patterns import errors

_REMEDY = "Give a value, {low, high} or {of}."


@dataclass(frozen=True, kw_only=True, slots=True)
class Range:
    """Any number between two, both possible: evenly, or evenly in its logarithm."""

    low: float
    high: float
    log: bool = False
    whole: bool = False

    def drawn(self, rng: np.random.Generator) -> float | int:
        """Draw a number."""
        if self.whole:
            return int(rng.integers(int(self.low), int(self.high), endpoint=True))
        if self.log:
            return float(np.exp(rng.uniform(math.log(self.low), math.log(self.high))))
        return float(rng.uniform(self.low, self.high))

    @property
    def ends(self) -> tuple[float | int, float | int]:
        """Least and largest, as they would be drawn."""
        return (int(self.low), int(self.high)) if self.whole else (self.low, self.high)


@dataclass(frozen=True, kw_only=True, slots=True)
class Choice:
    """One of some values, each as likely as another."""

    of: tuple[Any, ...]

    def drawn(self, rng: np.random.Generator) -> Any:
        """Draw a value."""
        return self.of[int(rng.integers(len(self.of)))]

    @property
    def ends(self) -> tuple[Any, ...]:
        """All of them."""
        return self.of


@dataclass(frozen=True, kw_only=True, slots=True)
class Fixed:
    """A value that is given."""

    value: Any

    def drawn(self, rng: np.random.Generator) -> Any:
        """Give the value; nothing is drawn."""
        return self.value

    @property
    def ends(self) -> tuple[Any, ...]:
        """The value."""
        return (self.value,)


Draw = Range | Choice | Fixed


def read(value: Any, name: str) -> Draw:
    """Read what a plan says of a value.

    Args:
        value: plain value as in TOML: itself, `{low, high, log, whole}`, or `{of = [...]}`.
        name: what refusals call it.

    Raises:
        InputError: unknown keys, or a range or choice that holds nothing.
    """
    if not isinstance(value, Mapping):
        return Fixed(value=value)
    for key in value:
        errors.one_of(f"key in {name}", key, ("low", "high", "log", "whole", "of"))
    if "of" in value:
        return _choice(value, name)
    return _range(value, name)


def _choice(table: Mapping[str, Any], name: str) -> Choice:
    of = table["of"]
    if len(table) > 1:
        raise errors.refuse(name, "must have no other key beside of", sorted(table), _REMEDY)
    if not isinstance(of, list) or not of:
        raise errors.refuse(f"{name}.of", "must list what is chosen from", repr(of), _REMEDY)
    return Choice(of=tuple(of))


def _range(table: Mapping[str, Any], name: str) -> Range:
    for key in ("low", "high"):
        if key not in table:
            raise errors.refuse(f"{name}.{key}", "must be given", "nothing", _REMEDY)
        errors.in_interval(f"{name}.{key}", table[key], -1e300, 1e300)
    for key in ("log", "whole"):
        if not isinstance(table.get(key, False), bool):
            rule = "must be true or false"
            raise errors.refuse(f"{name}.{key}", rule, repr(table[key]), "Write it without quotes.")
    found = Range(**table)
    if found.low > found.high:
        rule = f"must be >= {name}.low = {found.low:g}"
        raise errors.refuse(f"{name}.high", rule, f"{found.high:g}", "Swap them.")
    if found.log and (found.low <= 0 or found.whole):
        rule = "must be > 0, and no range of whole numbers, for log"
        raise errors.refuse(f"{name}.low", rule, f"{found.low:g}", "Leave out log.")
    if found.whole and not (float(found.low).is_integer() and float(found.high).is_integer()):
        raise errors.refuse(name, "must have whole ends", [found.low, found.high], "Round them.")
    return found
