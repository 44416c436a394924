"""How a command speaks and ends: results on standard output, one line of refusal, no traceback."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from starling.patterns.errors import InputError


@contextmanager
def termination_as_exit() -> Iterator[None]:
    """Let a process that is told to end clean up, so that nothing half-written stays."""
    if threading.current_thread() is not threading.main_thread():  # Only that one gets signals.
        yield
        return
    before = signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def say(value: Any, *, json: bool, as_text: Callable[[Any], str] | None = None) -> None:
    """Print a result: as JSON, else as text (`starling.sim.console.text.render` where nothing else is given)."""
    from starling.sim.console import record, text

    said = record.dumps(value) if json else (as_text or text.render)(value)
    print(said.rstrip("\n"))


def line_of(error: Exception) -> str:
    """One line for standard error."""
    from starling.sim.render.backend import BackendError

    message = " ".join(str(error).split())
    if isinstance(error, (InputError, BackendError)):
        return f"starling: {message}"
    return (
        f"starling: an error of starling itself, {type(error).__name__}: {message}. "
        "Run again with --debug and report what it prints."
    )


def warn(message: Warning | str, *_: Any, **__: Any) -> None:
    """Print a warning as one line, in `warnings.showwarning`'s place."""
    print(f"starling: warning: {message}", file=sys.stderr)
