"""Output and termination of a command: results as text or JSON, one line per error."""

from __future__ import annotations

import re
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from types import FrameType
from typing import Any

from starling.patterns.errors import InputError, refuse

TERMINATED = {129, 143}  # Exit codes after SIGHUP and SIGTERM: 128 and their numbers.
_AGAIN_S = 0.1  # A signal during an import is sent again after this time [s].


@contextmanager
def stopped_by_signals(*, ends: bool = False) -> Iterator[None]:
    """Turn SIGTERM and SIGHUP into `SystemExit`, so that partial output is removed.

    SIGINT is `KeyboardInterrupt`.

    A repeated signal is ignored, as it would end the removal. A signal that the caller ignores
    stays ignored. A signal waits for the end of an import: trimesh catches all exceptions in its.

    Args:
        ends: whether the process ends after the context: a signal that it received stays ignored.
    """
    if threading.current_thread() is not threading.main_thread():  # Only it receives signals.
        yield
        return
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = {number: signal.getsignal(number) for number in numbers}
    for number, handler in before.items():
        if handler != signal.SIG_IGN:
            signal.signal(number, _stop)
    try:
        yield
    finally:
        for number, handler in before.items():
            if not (ends and signal.getsignal(number) == signal.SIG_IGN):
                signal.signal(number, handler)


def _stop(number: int, frame: FrameType | None) -> None:
    if _imports(frame):
        main = threading.main_thread().ident or 0
        threading.Timer(_AGAIN_S, signal.pthread_kill, (main, number)).start()
        return
    signal.signal(number, signal.SIG_IGN)
    if number == signal.SIGINT:
        raise KeyboardInterrupt
    sys.exit(128 + number)


def _imports(frame: FrameType | None) -> bool:
    """Whether a frame belongs to an import that is not complete."""
    while frame is not None:
        if frame.f_code.co_filename == "<frozen importlib._bootstrap>":
            return True
        frame = frame.f_back
    return False


def say(value: Any, *, json: bool, as_text: Callable[[Any], str] | None = None) -> None:
    """Print a result as JSON, or as text; `as_text` defaults to `render`."""
    from starling.sim.console import record

    printed = record.dumps(value) if json else (as_text or render)(value)
    print(printed.rstrip("\n"))


def format_error(error: Exception) -> str:
    """Format an error as one line for standard error."""
    from starling.sim.render.backend import BackendError

    message = " ".join(str(error).split())
    if isinstance(error, (InputError, BackendError)):
        return f"starling: {message}"
    if isinstance(error, MemoryError):
        missing = message or "too little"
        return f"starling: memory must suffice; got {missing}. Use smaller images or fewer frames."
    return (
        f"starling: an error of starling itself, {type(error).__name__}: {message}. "
        "Run again with --debug and report what it prints."
    )


def format_lost_output(error: OSError) -> str:
    """Format the loss of standard output as one line."""
    advice = "Free some space, or send it elsewhere."
    return format_error(
        refuse("standard output", "must take the result", error.strerror or error, advice)
    )


def warn(message: Warning | str, *_: Any, **__: Any) -> None:
    """Print a warning as one line; replaces `warnings.showwarning`."""
    print(f"starling: warning: {message}", file=sys.stderr)


def render(value: Any) -> str:
    """Format nested tables as aligned lines; tables of equal rows become columns.

    Example:
        >>> print(render({"out": "sim", "scenes": {"a": {"fill": 0.9}, "b": {"fill": 0.8}}}))
        out  sim
        <BLANKLINE>
        scenes  fill
        a        0.9
        b        0.8
    """
    return re.sub(r"\n{3,}", "\n\n", "\n".join(_rows(value, "") or _lines(value, ""))).strip("\n")


def _lines(value: Any, title: str) -> list[str]:
    value = _numbered(value)
    if not isinstance(value, Mapping):
        return [_cell(value)]
    value = {key: _numbered(item) for key, item in value.items()}
    flat = {key: item for key, item in value.items() if not _is_table(item)}
    lines = [f"[{title}]"] if title and flat else []
    lines += _columns([[str(key), _cell(item)] for key, item in flat.items()], left=2)
    for key, item in value.items():
        if _is_table(item):
            name = f"{title} {key}".strip()
            lines += ["", *(_rows(item, name) or _lines(item, name))]
    return lines


def _numbered(value: Any) -> Any:
    """Turn a list of tables into a table of tables; other values stay."""
    if isinstance(value, (list, tuple)) and value and all(isinstance(v, Mapping) for v in value):
        return {str(number): row for number, row in enumerate(value)}
    return value


def _rows(table: Any, title: str) -> list[str]:
    """Format a table of equal rows, or of tables of equal rows, in columns; otherwise `[]`."""
    if not isinstance(table, Mapping) or not all(map(_is_table, table.values())):
        return []
    rows = {str(key): row for key, row in table.items()}
    if all(_holds_tables(row) for row in rows.values()):
        rows = {f"{key} {sub}": row for key, item in rows.items() for sub, row in item.items()}
    if any(not isinstance(row, Mapping) or _holds_tables(row) for row in rows.values()):
        return []
    heads = list(dict.fromkeys(head for row in rows.values() for head in row))
    body = [[key, *(_cell(row.get(head, "")) for head in heads)] for key, row in rows.items()]
    return _columns([[title, *heads], *body], left=1)


def _is_table(value: Any) -> bool:
    return isinstance(value, Mapping) and bool(value)


def _holds_tables(row: Any) -> bool:
    return isinstance(row, Mapping) and any(map(_is_table, row.values()))


def _columns(rows: Sequence[Sequence[str]], *, left: int) -> list[str]:
    """Align the first `left` columns to the left and the others to the right."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        "  ".join(
            cell.ljust(width) if number < left else cell.rjust(width)
            for number, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in rows
    ]


def _cell(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, (list, tuple)):
        return ", ".join(map(_cell, value)) or "-"
    if isinstance(value, Mapping):
        return "-"
    return "-" if value is None else str(value)
