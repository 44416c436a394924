"""A folder's files in memory, in the way `starling.sim.console.output.OutputFolder` takes them."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path


class Files:
    """Names and contents, in the order they were written."""

    def __init__(self, path: Path) -> None:
        """Begin with none; `path` is where they will stand."""
        self.path = path
        self.content: dict[str, bytes] = {}

    def write(self, name: str, data: bytes | str) -> None:
        """Keep one file; text is UTF-8."""
        self.content[name] = data.encode() if isinstance(data, str) else data

    def write_by(self, name: str, writer: Callable[[Path], object]) -> None:
        """Keep what `writer` writes at the path it is given."""
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / Path(name).name
            writer(path)
            self.content[name] = path.read_bytes()
