"""One run at a time works on a folder."""

from __future__ import annotations

import fcntl
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from starling.diagnosis.validation.camera.errors import refusal


@contextmanager
def alone(folder: Path) -> Iterator[None]:
    """Hold a folder, which is made where there is none, as long as the block lasts.

    Raises:
        WithheldError: if another process holds it.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / ".lock").open("w") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            rule, advice = "must be worked on by one run at a time", "End that, or wait for it."
            raise refusal("folder", rule, f"another in {folder}", advice) from error
        yield
