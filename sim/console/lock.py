"""Lock of an output folder against other runs."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from starling.patterns import errors
from starling.sim.console import output


@contextmanager
def exclusive(folder: Path) -> Iterator[None]:
    """Lock a folder that exists until the context ends.

    The folder itself is locked, so that nothing has to be removed. The lock ends with the process.

    Raises:
        InputError: if another run holds the lock, or the folder cannot be read.
    """
    with output.refused(folder):
        descriptor = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            rule, advice = "must be used by one run at a time", "End the other run, or wait for it."
            raise errors.refuse("out", rule, folder, advice) from error
        yield
    finally:
        os.close(descriptor)
