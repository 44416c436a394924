"""Families of the effect table and what each effect is confused with, as a file.

    python -m starling.diagnosis.validation.adapters.families OUT.json

For the check on withheld effects, which seals them before the first case is taken.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path

from starling.diagnosis.validation.adapters import program
from starling.patterns.errors import one_of
from starling.sim import effects
from starling.sim.console import output
from starling.sim.effects.effect import Effect


def twins(of: Effect) -> list[str]:
    """Effects that an effect's page says it is confused with, and those whose pages name it."""
    return [
        row.name
        for row in effects.table()
        if row.name in of.confused_with or of.name in row.confused_with
    ]


def known() -> list[str]:
    """All families of the table, by name."""
    return sorted({row.family for row in effects.table()})


def refuse_others(names: Iterable[str]) -> None:
    """Refuse names that are no family of the table.

    Raises:
        InputError: for the first of them.
    """
    for name in names:
        one_of("family", name, known())


def write(out: Path) -> None:
    """Write family and twins by effect."""
    told = {row.name: {"family": row.family, "twins": twins(row)} for row in effects.table()}
    output.write_file(out, f"{json.dumps(told, indent=1)}\n".encode())


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(
        prog="python -m starling.diagnosis.validation.adapters.families",
        description="Write the effect table's families.",
    )
    parser.add_argument("out", type=Path, help="JSON file")
    asked = parser.parse_args(arguments)
    return program.run(lambda _tell: write(asked.out))


if __name__ == "__main__":
    sys.exit(main())
