"""Common parts of the adapter programs: exit codes, and listing capture sets."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

from starling.patterns.errors import InputError, refuse
from starling.sim.console import progress


def run(work: Callable[[progress.Progress], None]) -> int:
    """Run a program; return 0 when it is done, or print one line and return 1 if refused."""
    try:
        with progress.on_stderr() as track:
            work(track)
    except InputError as error:
        print(error, file=sys.stderr)
        return 1
    return 0


def capture_sets(cases: Path) -> list[Path]:
    """List the capture sets in a folder by name, each in its own subfolder.

    Raises:
        InputError: if there is none.
    """
    folders = sorted(path.parent for path in cases.glob("*/capture.toml"))
    if not folders:
        raise refuse("cases", "must hold capture sets", cases, "Take captures first.")
    return folders
