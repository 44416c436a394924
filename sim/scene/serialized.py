"""Check of Mitsuba's `.serialized` meshes, whose triangles Mitsuba does not check."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import numpy as np

from starling.patterns import regular_file

_MAGIC = 0x041C
_PLACES = {3: "<u4", 4: "<u8"}  # Type of the meshes' places at the file's end, by version.
_DOUBLE = 0x2000
_ARRAYS = (
    (0x0001, 3),
    (0x0002, 2),
    (0x0008, 3),
)  # Flag, values a vertex: normals, texture, colour.


def refuse_damaged(path: Path) -> None:
    """Refuse a file whose triangles name missing vertices, or which is too short.

    Raises:
        ValueError: if the file is damaged; the message says how.
        OSError: if the file cannot be read.
    """
    data = regular_file.read(path)
    if len(data) < 8 or struct.unpack_from("<H", data)[0] != _MAGIC or data[2] not in _PLACES:
        raise ValueError("it is no serialized mesh of version 3 or 4")
    version = data[2]
    (count,) = struct.unpack_from("<I", data, len(data) - 4)
    dtype = np.dtype(_PLACES[version])
    first = len(data) - 4 - count * dtype.itemsize
    if first < 0:
        raise ValueError(f"it counts {count} meshes, which is more than it holds")
    for place in np.frombuffer(data, dtype, count, first).tolist():
        try:
            mesh = zlib.decompressobj().decompress(data[place + 4 :])
        except zlib.error as error:
            raise ValueError(f"{error}") from None
        _refuse_mesh(mesh, version)


def _refuse_mesh(mesh: bytes, version: int) -> None:
    start = mesh.index(b"\0", 4) + 1 if version == 4 else 4  # The name follows the flags.
    if len(mesh) < start + 16:
        raise ValueError("a mesh ends early")
    flags, vertices, triangles = (
        *struct.unpack_from("<I", mesh),
        *struct.unpack_from("<QQ", mesh, start),
    )
    columns = 3 + sum(values for flag, values in _ARRAYS if flags & flag)
    start += 16 + vertices * columns * (8 if flags & _DOUBLE else 4)
    dtype = np.dtype("<u4" if vertices < 2**32 else "<u8")
    if start + triangles * 3 * dtype.itemsize > len(mesh):
        raise ValueError(f"a mesh counts {vertices} vertices and {triangles} triangles, and is cut")
    corners = np.frombuffer(mesh, dtype, triangles * 3, start)
    if triangles and corners.max() >= vertices:
        raise ValueError("a triangle has a vertex that is missing")
