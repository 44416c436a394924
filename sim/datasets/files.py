"""A folder in memory with the interface of `starling.sim.console.output.Folder`."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path


class MemoryFolder:
    """Names and contents of files, in the order of writing."""

    def __init__(self, path: Path) -> None:
        """Create an empty folder; `path` is its later place on disk."""
        self.path = path
        self.content: dict[str, bytes] = {}

    def write(self, name: str, data: bytes | str) -> None:
        """Store one file; text is encoded as UTF-8."""
        self.content[name] = data.encode() if isinstance(data, str) else data

    def write_by(self, name: str, writer: Callable[[Path], object]) -> None:
        """Store the file that `writer` writes at the path passed to it."""
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / Path(name).name
            writer(path)
            self.content[name] = path.read_bytes()
