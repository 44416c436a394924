"""Check of OBJ files: the mesh reader wraps wrong vertex numbers and cuts concave faces wrongly."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from starling.patterns import regular_file
from starling.sim.scene.polygons import warn_of_concave

_FREE_FORM = {"curv", "curv2", "surf"}  # Curves and surfaces, which are not triangles.


def refuse_damaged(path: Path) -> None:
    """Refuse faces that name missing vertices; warn of content that the reader cuts or ignores.

    Raises:
        ValueError: if the file is damaged; the message says how.
        OSError: if the file cannot be read.
    """
    points: list[list[str]] = []
    polygons: list[list[int]] = []
    ignored: set[str] = set()
    for keyword, *values in _statements(regular_file.read(path)):
        if keyword == "v":
            points.append(values[:3])
        elif keyword == "f":
            corners = [_corner(value, len(points)) for value in values]
            if len(corners) < 3:
                raise ValueError(f"a face has {len(corners)} vertices")
            polygons.append(corners)
        elif keyword in _FREE_FORM:
            ignored.add(keyword)
    if any(max(corners) >= len(points) for corners in polygons):
        raise ValueError("a triangle has a vertex that is missing")
    if ignored:
        names = ", ".join(sorted(ignored))
        warnings.warn(f"{path}: {names} not used; triangles only. Convert them.", stacklevel=3)
    lengths = {len(corners) for corners in polygons} - {3}
    if lengths:
        wide = [[p for p in polygons if len(p) == length] for length in lengths]
        warn_of_concave(path, np.array(points, np.float64), map(np.array, wide))


def _statements(data: bytes) -> Iterator[list[str]]:
    """Words of each line; a backslash at its end continues a line."""
    text = data.decode("utf-8-sig", errors="replace").replace("\\\r\n", " ").replace("\\\n", " ")
    for line in text.splitlines():
        words = line.partition("#")[0].split()
        if words and words[0] in ("v", "f") and not line.startswith(f"{words[0]} "):
            raise ValueError(f"a line starts with {line[:2]!r}, not {words[0]!r} and a space")
        if words:
            yield words


def _corner(value: str, count: int) -> int:
    """Vertex of a corner such as `3/1/2`, from 0; negative numbers count from the last vertex."""
    number = int(value.partition("/")[0])
    vertex = number - 1 if number > 0 else count + number
    if number == 0 or vertex < 0:
        raise ValueError(f"a face has the vertex {number}, which is missing")
    return vertex
