"""Keys of a plan's tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from starling.patterns import errors


def refuse_unknown(table: Mapping[str, Any], known: Sequence[str], name: str) -> None:
    """Refuse keys that mean nothing, the nearest that does first.

    Raises:
        InputError: if there is one.
    """
    for key in table:
        errors.one_of(f"key in {name}", key, known)


def weight(table: Mapping[str, Any], name: str) -> float:
    """How often one of several is drawn, over the sum of all weights.

    Raises:
        InputError: if it is not above zero.
    """
    value = table.get("weight", 1.0)
    errors.positive(f"{name}.weight", value)
    return float(value)


def text(table: Mapping[str, Any], key: str, name: str, example: str) -> str:
    """A word that must be there.

    Raises:
        InputError: if it is not, or no text.
    """
    value = table.get(key)
    if not isinstance(value, str) or not value:
        raise errors.refuse(f"{name}.{key}", "must be a text", repr(value), f"As {example!r}.")
    return value
