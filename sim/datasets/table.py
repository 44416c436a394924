"""Validation of keys and values in a plan's tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from starling.patterns import errors


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
