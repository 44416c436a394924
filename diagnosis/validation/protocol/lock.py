"""Exclusive lock of a folder between processes."""

from __future__ import annotations

import fcntl
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from starling.diagnosis.validation.camera.errors import refusal


@contextmanager
def exclusive(folder: Path) -> Iterator[None]:
    """Lock a folder for the duration of the block. The folder is created if missing.

    Raises:
        WithheldError: if another process holds the lock.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / ".lock").open("w") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            rule, advice = "must be used by one run at a time", "End the other run or wait for it."
            raise refusal("folder", rule, f"another run in {folder}", advice) from error
        yield
