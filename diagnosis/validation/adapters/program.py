"""How programs of the diagnosis end that files alone are told to (`python -m diagnosis.NAME`)."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

from starling.patterns.errors import InputError, refuse
from starling.sim.console import progress


def run(work: Callable[[progress.Progress], None]) -> int:
    """Do a program's work: 0 when it is done, 1 where something is refused, in one line."""
    try:
        with progress.on_stderr() as track:
            work(track)
    except InputError as error:
        print(error, file=sys.stderr)
        return 1
    return 0


def capture_sets(cases: Path) -> list[Path]:
    """Capture sets that a folder holds, each in a folder of its own, by name.

    Raises:
        InputError: if there is none.
    """
    folders = sorted(path.parent for path in cases.glob("*/capture.toml"))
    if not folders:
        raise refuse("cases", "must hold capture sets", cases, "Take captures first.")
    return folders
