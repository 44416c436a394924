"""Families of the effect table, and the confusable effects of each effect."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path

from tyro.conf import Positional

from starling.patterns.errors import one_of
from starling.sim import effects
from starling.sim.console import output
from starling.sim.effects.effect import Effect


def confusable(effect: Effect) -> list[str]:
    """List effects that the effect table marks as confusable with an effect, either way."""
    return [
        row.name
        for row in effects.table()
        if row.name in effect.confused_with or effect.name in row.confused_with
    ]


def known() -> list[str]:
    """List all families of the effect table by name."""
    return sorted({row.family for row in effects.table()})


def refuse_unknown_families(names: Iterable[str]) -> None:
    """Refuse names that are not families of the effect table.

    Raises:
        InputError: for the first unknown name.
    """
    for name in names:
        one_of("family", name, known())


def families(out: Positional[Path]) -> None:
    """Write the family and the confusable effects of each effect.

    The validation with withheld effects seals this file before the first case is captured.

    Args:
        out: JSON file.
    """
    rows = {row.name: {"family": row.family, "twins": confusable(row)} for row in effects.table()}
    output.write_file(out, f"{json.dumps(rows, indent=1)}\n".encode())
