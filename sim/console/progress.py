"""Progress reporting: a wrapper around the items of a loop."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

# Takes the items of a loop and a label such as "simulate"; yields the items one by one.
Progress = Callable[[Sequence[Any], str], Iterable[Any]]

Note = Callable[[str], None]  # Takes one line of text for the user.

_QUIET_S = 10.0  # Least time between two lines; shorter work prints nothing [s].


def silent(items: Sequence[Any], label: str) -> Iterable[Any]:
    """Report no progress."""
    del label
    return items


def ignore_note(line: str) -> None:
    """Discard a line."""
    del line


def note_on_stderr(line: str) -> None:
    """Print a line on standard error."""
    print(f"starling: {line}", file=sys.stderr, flush=True)


@contextmanager
def on_stderr() -> Iterator[Progress]:
    """Report on standard error: a transient bar on a terminal, otherwise lines now and then."""
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
    started = last = time.monotonic()
    for number, item in enumerate(items, 1):
        yield item
        now = time.monotonic()
        closing = number == len(items) and last > started
        if closing or now - last > _QUIET_S:
            print(f"{label} {number}/{len(items)}", file=sys.stderr, flush=True)
            last = now
