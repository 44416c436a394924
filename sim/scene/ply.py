"""Check of PLY files: the mesh readers of trimesh and Mitsuba accept many damaged ones."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from starling.patterns import regular_file
from starling.sim.scene.polygons import warn_of_concave

_TYPES = {
    "char": "i1",
    "int8": "i1",
    "uchar": "u1",
    "uint8": "u1",
    "short": "i2",
    "int16": "i2",
    "ushort": "u2",
    "uint16": "u2",
    "int": "i4",
    "int32": "i4",
    "uint": "u4",
    "uint32": "u4",
    "int64": "i8",
    "uint64": "u8",
    "float16": "f2",
    "float": "f4",
    "float32": "f4",
    "double": "f8",
    "float64": "f8",
}
_ORDERS = {"ascii": None, "binary_little_endian": "<", "binary_big_endian": ">"}
_CORNERS = ("vertex_index", "vertex_indices")  # Lists of a face's vertices.


@dataclass(frozen=True)
class _Property:
    name: str
    dtype: np.dtype
    count: np.dtype | None  # Type of a list's length; None for a single value.


@dataclass(frozen=True)
class _Element:
    name: str
    rows: int
    properties: list[_Property] = field(default_factory=list)


@dataclass(frozen=True)
class _Faces:
    """Vertices of the file, and its faces of more than three corners."""

    vertices: int
    points: dict[str, NDArray[np.float64]] = field(default_factory=dict)  # By name: x, y, z.
    polygons: list[NDArray[np.int64]] = field(default_factory=list)


def refuse_damaged(path: Path) -> None:
    """Refuse a file whose rows contradict its header, or whose faces name missing vertices.

    Concave faces, which the reader cuts wrongly, give a warning.

    Raises:
        ValueError: if the file is damaged; the message says how.
        OSError: if the file cannot be read.
    """
    data = regular_file.read(path)
    match = re.match(rb"ply[ \t]*\r?\n(.*?\n)end_header[ \t]*\r?\n", data, re.DOTALL)
    if match is None:
        raise ValueError("a PLY starts with ply and its header ends with end_header")
    order, elements = _header(match[1].decode().splitlines())
    faces = _Faces(sum(element.rows for element in elements if element.name == "vertex"))
    body = data[match.end() :]
    if order is None:
        _refuse_text(body.decode(), elements, faces)
    else:
        _refuse_binary(body, elements, faces)
    if faces.polygons and {"x", "y", "z"} <= faces.points.keys():
        points = np.stack([faces.points[axis] for axis in "xyz"], axis=1)
        warn_of_concave(path, points, faces.polygons)


def _header(lines: list[str]) -> tuple[str | None, list[_Element]]:
    """Byte order, None of text, and the elements."""
    words = lines[0].split()
    if len(words) != 3 or words[0] != "format" or words[1] not in _ORDERS:
        raise ValueError(f"its second line must state a known format, not {lines[0]!r}")
    order = _ORDERS[words[1]]
    elements: list[_Element] = []
    for line in lines[1:]:
        words = line.split()
        if words[:1] == ["element"] and len(words) == 3:
            elements.append(_Element(words[1], int(words[2])))
        elif words[:1] == ["property"] and elements and _is_property(words):
            single = _Property(words[-1], np.dtype((order or "<") + _TYPES[words[-2]]), None)
            if len(words) == 5:
                length = np.dtype((order or "<") + _TYPES[words[2]])
                single = _Property(single.name, single.dtype, length)
            elements[-1].properties.append(single)
        elif words[:1] not in (["comment"], ["obj_info"]):
            raise ValueError(f"its header has the unknown line {line!r}")
    for element in elements:
        if element.rows < 0:
            raise ValueError(f"its header counts {element.rows} rows of {element.name}")
        if element.name == "tristrips" and element.rows:
            raise ValueError("triangle strips are not supported; export triangles")
    return order, elements


def _is_property(words: list[str]) -> bool:
    if len(words) == 5:
        return words[1] == "list" and {*words[2:4]} <= _TYPES.keys() and _TYPES[words[2]][0] != "f"
    return len(words) == 3 and words[1] in _TYPES


def _refuse_text(text: str, elements: list[_Element], faces: _Faces) -> None:
    rows = [line.split() for line in text.rstrip().splitlines()]
    expected = sum(element.rows for element in elements)
    if len(rows) != expected:
        raise ValueError(f"its header counts {expected} rows, and {len(rows)} follow")
    start = 0
    for element in elements:
        part = rows[start : start + element.rows]
        start += element.rows
        for length in {len(row) for row in part}:
            table = np.array([row for row in part if len(row) == length], dtype=np.float64)
            _refuse_cells(table, element.properties, element.name, faces)
            if element.name == "vertex" and not any(entry.count for entry in element.properties):
                names = [entry.name for entry in element.properties]
                faces.points.update(zip(names, table.T, strict=True))


def _refuse_cells(
    table: NDArray[np.float64], properties: list[_Property], element: str, faces: _Faces
) -> None:
    """Check rows (n, values) of equally many values, property by property."""
    if not properties and table.shape[1]:
        raise ValueError(f"a row of {element} has too many values")
    if not properties:
        return
    if not table.shape[1]:
        raise ValueError(f"a row of {element} has too few values")
    first, rest = properties[0], properties[1:]
    if first.count is None:
        _refuse_numbers(table[:, :1], first.dtype, first.name)
        _refuse_cells(table[:, 1:], rest, element, faces)
        return
    _refuse_numbers(table[:, :1], first.count, f"{first.name} (length)")
    for count in np.unique(table[:, 0]).astype(int):
        part = table[table[:, 0] == count]
        if not 0 <= count < part.shape[1]:
            raise ValueError(f"a row of {element} has too few values")
        values = part[:, 1 : 1 + count]
        _refuse_numbers(values, first.dtype, first.name)
        _refuse_corners(values, first.name, faces)
        _refuse_cells(part[:, 1 + count :], rest, element, faces)


def _refuse_numbers(values: NDArray[np.float64], dtype: np.dtype, name: str) -> None:
    if dtype.kind == "f":
        return
    limits = np.iinfo(dtype)
    outside = ~((values >= limits.min) & (values <= limits.max) & (values == np.floor(values)))
    if outside.any():
        rule = f"whole numbers from {limits.min} to {limits.max}"
        raise ValueError(f"{name} holds {rule}, not {values[outside][0]:g}")


def _refuse_corners(corners: NDArray, name: str, faces: _Faces) -> None:
    """Check the vertices (n, corners) of faces."""
    if name not in _CORNERS or not len(corners):
        return
    if corners.shape[1] < 3:
        raise ValueError(f"a face has {corners.shape[1]} vertices")
    if not 0 <= corners.min() <= corners.max() < faces.vertices:
        raise ValueError("a triangle has a vertex that is missing")
    if corners.shape[1] > 3:
        faces.polygons.append(corners.astype(np.int64))


def _refuse_binary(body: bytes, elements: list[_Element], faces: _Faces) -> None:
    start = 0
    for element in elements:
        if not element.rows:
            continue
        fields: list[tuple[str, np.dtype, tuple[int]]] = []
        for entry in element.properties:
            length = 1
            if entry.count is not None:  # Lists are as long as in the first row.
                first = start + np.dtype(fields).itemsize
                length = int(np.frombuffer(body[first:], entry.count, 1)[0])
                fields.append((f"length of {entry.name}", entry.count, (1,)))
            fields.append((entry.name, entry.dtype, (length,)))
        dtype = np.dtype(fields)
        end = start + element.rows * dtype.itemsize
        if end > len(body):
            rule = f"its header counts {element.rows} rows of {element.name}"
            raise ValueError(f"{rule}, which is more than the file holds")
        table = np.frombuffer(body[start:end], dtype)
        for entry in element.properties:
            lengths = table[f"length of {entry.name}"] if entry.count is not None else []
            if len(np.unique(lengths)) > 1:
                raise ValueError(f"lists of different length in {entry.name} need the text format")
            if entry.count is not None:
                _refuse_corners(table[entry.name], entry.name, faces)
            elif element.name == "vertex":
                faces.points[entry.name] = table[entry.name][:, 0].astype(np.float64)
        start = end
    if start != len(body):
        raise ValueError(f"{len(body) - start} bytes follow its last row")
