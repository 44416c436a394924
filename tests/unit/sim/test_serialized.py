"""Mitsuba's `.serialized` meshes: damaged ones are refused, since Mitsuba would read past them."""

import struct
import zlib
from pathlib import Path

import numpy as np
import pytest

from starling.patterns import InputError
from starling.sim.scene import mitsuba_xml

CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]])
XML = """<scene version="3.0.0"><shape type="serialized">
<string name="filename" value="mesh.serialized"/></shape></scene>"""
SINGLE, DOUBLE, NORMALS, TEXTURE = 0x1000, 0x2000, 0x0001, 0x0002


def _mesh(faces: list[int], flags: int = SINGLE, vertices: int = 3, version: int = 4) -> bytes:
    """Write a file of one mesh."""
    number = "<f8" if flags & DOUBLE else "<f4"
    body = struct.pack("<I", flags) + (b"name\0" if version == 4 else b"")
    body += struct.pack("<QQ", vertices, len(faces) // 3) + CORNERS.astype(number).tobytes()
    body += np.ones(3 * (3 * bool(flags & NORMALS) + 2 * bool(flags & TEXTURE)), number).tobytes()
    body += np.array(faces, "<u4").tobytes()
    end = struct.pack("<QI" if version == 4 else "<II", 0, 1)
    return struct.pack("<HH", 0x041C, version) + zlib.compress(body) + end


def _load(folder: Path, data: bytes) -> int:
    """Number of triangles of a scene with the mesh."""
    (folder / "mesh.serialized").write_bytes(data)
    (folder / "scene.xml").write_text(XML)
    (shape,) = mitsuba_xml.load(folder / "scene.xml").shapes
    return shape.primitive_count()


@pytest.mark.parametrize("flags", [SINGLE, DOUBLE, SINGLE | NORMALS, DOUBLE | NORMALS | TEXTURE])
@pytest.mark.parametrize("version", [3, 4])
def test_sound_meshes_are_read(tmp_path: Path, flags: int, version: int):
    assert _load(tmp_path, _mesh([0, 1, 2, 0, 2, 1], flags, version=version)) == 2


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (_mesh([0, 1, 3]), "a triangle has a vertex that is missing"),
        (_mesh([0, 1, 2_000_000_000]), "a triangle has a vertex that is missing"),
        (_mesh([0, 1, 9], DOUBLE | NORMALS), "is missing"),
        (_mesh([0, 1, 2], vertices=10**12), "1000000000000 vertices and 1 triangles, and is cut"),
        (b"no mesh at all", "it is no serialized mesh of version 3 or 4"),
        (_mesh([0, 1, 2])[:-4] + b"\xff" * 4, "it counts 4294967295 meshes"),
        (_mesh([0, 1, 2])[:4] + b"text" + _mesh([0, 1, 2])[8:], "incorrect header check"),
        (
            struct.pack("<HH", 0x041C, 3) + zlib.compress(b"1234") + struct.pack("<II", 0, 1),
            "a mesh ends early",
        ),
    ],
)
def test_damaged_meshes_are_refused(tmp_path: Path, data: bytes, reason: str):
    message = rf"shape in .*scene\.xml must be a mesh; got .*mesh\.serialized\. .*{reason}"
    with pytest.raises(InputError, match=message):
        _load(tmp_path, data)
