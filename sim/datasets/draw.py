"""Values of a plan's tables: checks, and values that are drawn at random."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from starling.patterns import errors

_REMEDY = "Give a value, {low, high} or {of}."


@dataclass(frozen=True, kw_only=True, slots=True)
class Range:
    """A number between two ends, both included; uniform, or uniform in its logarithm."""

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
        """Least and largest value, in the type of drawn values."""
        return (int(self.low), int(self.high)) if self.whole else (self.low, self.high)


@dataclass(frozen=True, kw_only=True, slots=True)
class Choice:
    """One of several equally likely values."""

    values: tuple[Any, ...]

    def drawn(self, rng: np.random.Generator) -> Any:
        """Draw a value."""
        return self.values[int(rng.integers(len(self.values)))]

    @property
    def ends(self) -> tuple[Any, ...]:
        """All values."""
        return self.values


@dataclass(frozen=True, kw_only=True, slots=True)
class Fixed:
    """A fixed value."""

    value: Any

    def drawn(self, rng: np.random.Generator) -> Any:
        """Return the value; no random number is used."""
        return self.value

    @property
    def ends(self) -> tuple[Any, ...]:
        """The value."""
        return (self.value,)


Draw = Range | Choice | Fixed


def read(value: Any, name: str) -> Draw:
    """Parse a value of a plan.

    Args:
        value: TOML value: a fixed value, `{low, high, log, whole}`, or `{of = [...]}`.
        name: name of the value in error messages.

    Raises:
        InputError: if a key is unknown, or a range or choice is empty.
    """
    if not isinstance(value, Mapping):
        return Fixed(value=value)
    for key in value:
        errors.one_of(f"key in {name}", key, ("low", "high", "log", "whole", "of"))
    if "of" in value:
        return _choice(value, name)
    return _range(value, name)


def _choice(table: Mapping[str, Any], name: str) -> Choice:
    values = table["of"]
    if len(table) > 1:
        raise errors.refuse(name, "must have no key other than of", sorted(table), _REMEDY)
    if not isinstance(values, list) or not values:
        raise errors.refuse(f"{name}.of", "must list the choices", repr(values), _REMEDY)
    return Choice(values=tuple(values))


def _range(table: Mapping[str, Any], name: str) -> Range:
    for key in ("low", "high"):
        if key not in table:
            raise errors.refuse(f"{name}.{key}", "must be given", "nothing", _REMEDY)
        errors.in_interval(f"{name}.{key}", table[key], -1e300, 1e300)
    for key in ("log", "whole"):
        if not isinstance(table.get(key, False), bool):
            rule = "must be true or false"
            raise errors.refuse(f"{name}.{key}", rule, repr(table[key]), "Write it without quotes.")
    bounds = Range(**table)
    if bounds.low > bounds.high:
        rule = f"must be >= {name}.low = {bounds.low:g}"
        raise errors.refuse(f"{name}.high", rule, f"{bounds.high:g}", "Swap them.")
    if bounds.log and (bounds.low <= 0 or bounds.whole):
        rule = "must be > 0, and no range of whole numbers, for log"
        raise errors.refuse(f"{name}.low", rule, f"{bounds.low:g}", "Leave out log.")
    if bounds.whole and not (float(bounds.low).is_integer() and float(bounds.high).is_integer()):
        raise errors.refuse(name, "must have whole ends", [bounds.low, bounds.high], "Round them.")
    return bounds


def refuse_unknown(table: Mapping[str, Any], known: Sequence[str], name: str) -> None:
    """Refuse unknown keys; the message suggests the most similar known key.

    Raises:
        InputError: if a key is unknown.
    """
    for key in table:
        errors.one_of(f"key in {name}", key, known)


def weight(table: Mapping[str, Any], name: str) -> float:
    """Return the weight of an entry: its probability is the weight over the sum of all weights.

    Raises:
        InputError: if the weight is not above zero.
    """
    value = table.get("weight", 1.0)
    errors.positive(f"{name}.weight", value)
    return float(value)


def text(table: Mapping[str, Any], key: str, name: str, example: str) -> str:
    """Return a required text.

    Raises:
        InputError: if the value is missing, empty or no text.
    """
    value = table.get(key)
    if not isinstance(value, str) or not value:
        raise errors.refuse(f"{name}.{key}", "must be a text", repr(value), f"As {example!r}.")
    return value
