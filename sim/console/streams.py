"""Standard streams of a program: closed, full and narrow ones do not stop it."""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, TextIO


class _Descriptor(io.RawIOBase):
    """A file descriptor whose first error of writing is kept, not raised."""

    def __init__(self, number: int) -> None:
        self._number = number
        self.error: OSError | None = None

    def writable(self) -> bool:
        """Whether data can be written."""
        return True

    def fileno(self) -> int:
        """Return the file descriptor."""
        return self._number

    def isatty(self) -> bool:
        """Whether it is a terminal."""
        return os.isatty(self._number)

    def write(self, data: Any) -> int:
        """Write bytes; return how many are done with."""
        try:
            return os.write(self._number, data)
        except OSError as error:
            self.error = self.error or error
            return len(data)


class Output:
    """Standard output, and what became of it."""

    def __init__(self, descriptor: _Descriptor | None) -> None:
        """Watch a descriptor; None where the caller has replaced standard output."""
        self._descriptor = descriptor

    def loss(self) -> OSError | None:
        """Return why output was lost; None where the reader has closed the pipe himself."""
        if self._descriptor is None:
            return None
        sys.stdout.flush()
        error = self._descriptor.error
        return None if isinstance(error, BrokenPipeError) else error


@contextmanager
def usable() -> Iterator[Output]:
    """Let standard streams take every text and raise no error of writing.

    Characters outside a stream's encoding are printed as escapes. A closed stream is silent.
    Streams that the caller has replaced stay.
    """
    _fill_closed()
    before = sys.stdout, sys.stderr
    descriptor = None
    if sys.stdout is sys.__stdout__:
        descriptor = _Descriptor(1)
        sys.stdout = _text(descriptor, before[0])
    if sys.stderr is sys.__stderr__:
        sys.stderr = _text(_Descriptor(2), before[1], line_buffering=True)
    try:
        yield Output(descriptor)
    finally:
        for stream in (sys.stdout, sys.stderr):
            stream.flush()
        sys.stdout, sys.stderr = before


def _text(
    descriptor: _Descriptor, before: TextIO | None, *, line_buffering: bool = False
) -> TextIO:
    if before is not None:
        before.flush()
    return io.TextIOWrapper(
        io.BufferedWriter(descriptor),
        encoding="utf-8" if before is None else before.encoding,
        errors="backslashreplace",
        line_buffering=line_buffering or descriptor.isatty(),
    )


def _fill_closed() -> None:
    """Open the null device in place of closed streams; otherwise another file gets their number."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)
