"""Paths for the OpenEXR library, which takes UTF-8 only."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def for_reading(path: Path) -> Iterator[str]:
    """Yield the path of a file, or that of a copy until the context ends."""
    if _is_utf8(path):
        yield str(path)
        return
    with tempfile.TemporaryDirectory(prefix="starling-") as folder:
        copy = Path(folder) / "copy"
        shutil.copyfile(path, copy)
        yield str(copy)


@contextmanager
def for_writing(path: Path) -> Iterator[str]:
    """Yield the path of a file, or that of a temporary one that is moved there at the end."""
    if _is_utf8(path):
        yield str(path)
        return
    with tempfile.TemporaryDirectory(prefix="starling-") as folder:
        written = Path(folder) / "new"
        yield str(written)
        shutil.copyfile(written, path)


def _is_utf8(path: Path | str) -> bool:
    try:
        str(path).encode()
    except UnicodeEncodeError:
        return False
    return True
