"""How long work tells that it goes on: a wrapper around whatever it loops over."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

# Takes the items and what is done with them ("simulate"), gives the items back one by one.
Progress = Callable[[Sequence[Any], str], Iterable[Any]]

Note = Callable[[str], None]  # Takes a line that a user should read.

_QUIET_S = 1.0  # Work shorter than this says nothing.


def silent(items: Sequence[Any], label: str) -> Iterable[Any]:
    """Tell nothing."""
    del label
    return items


def unsaid(line: str) -> None:
    """Say nothing."""
    del line


def note_on_stderr(line: str) -> None:
    """Say a line on standard error."""
    print(f"starling: {line}", file=sys.stderr, flush=True)


@contextmanager
def on_stderr() -> Iterator[Progress]:
    """Tell on standard error: a bar on a terminal, which goes away, else a line an item."""
    if not sys.stderr.isatty():
        yield _lines
        return
    from rich import progress
    from rich.console import Console

    bar = progress.Progress(
        progress.TextColumn("{task.description}"),
        progress.BarColumn(),
        progress.MofNCompleteColumn(),
        progress.TimeElapsedColumn(),
        console=Console(stderr=True),
        transient=True,
    )
    with bar:
        yield lambda items, label: bar.track(items, description=label)


def _lines(items: Sequence[Any], label: str) -> Iterable[Any]:
    started = time.monotonic()
    for number, item in enumerate(items, 1):
        yield item
        if time.monotonic() - started > _QUIET_S:
            print(f"{label} {number}/{len(items)}", file=sys.stderr, flush=True)
