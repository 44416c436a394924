"""Output and termination of a command: results on standard output, one line per error."""

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
    """Turn SIGTERM into `SystemExit`, so that partial output is removed."""
    if threading.current_thread() is not threading.main_thread():  # Only it receives signals.
        yield
        return
    before = signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def say(value: Any, *, json: bool, as_text: Callable[[Any], str] | None = None) -> None:
    """Print a result as JSON, or as text; `as_text` defaults to `text.render`."""
    from starling.sim.console import record, text

    printed = record.dumps(value) if json else (as_text or text.render)(value)
    print(printed.rstrip("\n"))


def format_error(error: Exception) -> str:
    """Format an error as one line for standard error."""
    from starling.sim.render.backend import BackendError

    message = " ".join(str(error).split())
    if isinstance(error, (InputError, BackendError)):
        return f"starling: {message}"
    return (
        f"starling: an error of starling itself, {type(error).__name__}: {message}. "
        "Run again with --debug and report what it prints."
    )


def warn(message: Warning | str, *_: Any, **__: Any) -> None:
    """Print a warning as one line; replaces `warnings.showwarning`."""
    print(f"starling: warning: {message}", file=sys.stderr)
