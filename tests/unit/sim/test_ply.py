"""PLY files that contradict themselves are refused, and odd but correct ones are read."""

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh

from starling.patterns import InputError
from starling.sim.scene import sources

BOX = trimesh.creation.box()
TEXT = """ply
format ascii 1.0
comment by hand
element vertex 4
property float x
property float y
property float z
property uchar red
element face 2
property list uchar int vertex_indices
end_header
0 0 0 10
1 0 0 20
1 1 0 30
0 1 0 255
3 0 1 2
3 0 2 3
"""
SWAPS = [
    ("\n3 0 2 3\n", "\n", "its header counts 6 rows, and 5 follow"),
    ("3 0 2 3\n", "3 0 2 3\n3 0 1 3\n", "its header counts 6 rows, and 7 follow"),
    ("1 1 0 30", "1 1 0", "a row of vertex has too few values"),
    ("1 1 0 30", "1 1 0 30 7", "a row of vertex has too many values"),
    ("3 0 2 3", "4 0 2 3", "a row of face has too few values"),
    ("3 0 2 3", "3 0 2 3 1", "a row of face has too many values"),
    ("1 1 0 30", "1 1 0 300", "red holds whole numbers from 0 to 255, not 300"),
    ("1 1 0 30", "1 1 0 -1", "red holds whole numbers from 0 to 255, not -1"),
    ("1 1 0 30", "1 1 0 nan", "red holds whole numbers from 0 to 255, not nan"),
    ("1 1 0 30", "1 1 0 red", "could not convert string to float"),
    ("3 0 2 3", "3 0 2 2.5", "vertex_indices holds whole numbers"),
    ("3 0 2 3", "-3 0 2 3", "vertex_indices (length) holds whole numbers"),
    ("3 0 2 3", "3 0 2 4", "a triangle has a vertex that is missing"),
    ("3 0 2 3", "3 0 2 -1", "a triangle has a vertex that is missing"),
    ("3 0 2 3", "2 0 2", "a face has 2 vertices"),
    ("vertex 4", "vertex -4", "its header counts -4 rows of vertex"),
    ("vertex 4", "vertex 99999999999", "its header counts 100000000001 rows, and 6 follow"),
    ("vertex 4", "vertex four", "invalid literal for int"),
    ("element face 2", "element tristrips 2", "triangle strips are not supported"),
    ("property uchar red", "property half red", "the unknown line 'property half red'"),
    ("list uchar", "list float", "the unknown line 'property list float int vertex_indices'"),
    ("format ascii 1.0", "format words 1.0", "a known format, not 'format words 1.0'"),
    ("end_header", "end", "a PLY starts with ply and its header ends with end_header"),
]


@pytest.mark.parametrize(("old", "new", "reason"), SWAPS)
def test_text_that_contradicts_its_header_is_refused(
    tmp_path: Path, old: str, new: str, reason: str
):
    path = tmp_path / "square.ply"
    path.write_text(TEXT.replace(old, new))
    with pytest.raises(
        InputError, match=rf"square\.ply\. It cannot be read: .*{re.escape(reason)}"
    ):
        sources.mesh_parts(path)


def _box() -> bytes:
    data = BOX.export(file_type="ply")
    assert isinstance(data, bytes)
    return data


def _header(data: bytes) -> int:
    return data.index(b"end_header\n") + len(b"end_header\n")


def _corner(data: bytes, value: int) -> bytes:
    return data[:-4] + np.int32(value).tobytes()


def _length(data: bytes, value: int) -> bytes:
    return data[:-13] + bytes([value]) + data[-12:]


@pytest.mark.parametrize(
    ("damaged", "reason"),
    [
        (lambda data: _corner(data, 8), "a triangle has a vertex that is missing"),
        (lambda data: _corner(data, -1), "a triangle has a vertex that is missing"),
        (lambda data: _corner(data, 2_000_000_000), "a triangle has a vertex that is missing"),
        (lambda data: _length(data, 4), "lists of different length in vertex_indices"),
        (lambda data: data + b"1234", "4 bytes follow its last row"),
        (lambda data: data[:-1], "12 rows of face, which is more than the file holds"),
        (
            lambda data: data.replace(b"vertex 8", b"vertex 99999999999"),
            "99999999999 rows of vertex, which is more than the file holds",
        ),
        (lambda data: data.replace(b"vertex 8", b"vertex -8"), "counts -8 rows of vertex"),
        (lambda data: data[: _header(data)], "8 rows of vertex, which is more than the file holds"),
    ],
)
def test_binary_that_contradicts_its_header_is_refused(
    tmp_path: Path, damaged: Callable[[bytes], bytes], reason: str
):
    path = tmp_path / "box.ply"
    path.write_bytes(damaged(_box()))
    with pytest.raises(InputError, match=f"It cannot be read: .*{reason}"):
        sources.mesh_parts(path)


def test_triangles_and_squares_may_mix_in_text(tmp_path: Path):
    path = tmp_path / "square.ply"
    path.write_text(TEXT.replace("face 2", "face 3") + "4 0 1 2 3\n\n")
    ((_, mesh),) = sources.mesh_parts(path)
    assert len(mesh.faces) == 4


def test_two_lists_a_row_are_read(tmp_path: Path):
    path = tmp_path / "textured.ply"
    header = "vertex_indices\nproperty list uchar float texcoord"
    rows = "3 0 1 2 6 0 0 1 0 1 1\n3 0 2 3 6 0 0 1 1 0 1\n"
    text = TEXT.replace("vertex_indices", header).replace("3 0 1 2\n3 0 2 3\n", rows)
    path.write_text(text)
    ((_, mesh),) = sources.mesh_parts(path)
    assert len(mesh.faces) == 2


@pytest.mark.parametrize("order", ["<", ">"])
def test_binary_of_both_byte_orders_is_read(tmp_path: Path, order: str):
    name = {"<": "little", ">": "big"}[order]
    data = _box()
    vertices = np.asarray(BOX.vertices, f"{order}f4").tobytes()
    face = np.dtype([("length", "u1"), ("corners", f"{order}i4", 3)])
    faces = np.zeros(len(BOX.faces), face)
    faces["length"], faces["corners"] = 3, BOX.faces
    header = data[: _header(data)].replace(b"little", name.encode())
    (tmp_path / "box.ply").write_bytes(header + vertices + faces.tobytes())
    ((_, mesh),) = sources.mesh_parts(tmp_path / "box.ply")
    assert np.array_equal(mesh.faces, BOX.faces)


def _polygon(points: str, corners: str, form: str) -> bytes:
    """A PLY of one face with points in the plane z = 1."""
    rows = [[float(word) for word in point.split()] for point in points.split(",")]
    face = [int(word) for word in corners.split()]
    header = (
        f"ply\nformat {form} 1.0\nelement vertex {len(rows)}\nproperty float x\n"
        "property float y\nproperty float z\nelement face 1\n"
        "property list uchar int vertex_indices\nend_header\n"
    ).encode()
    if form == "ascii":
        lines = [f"{x} {y} 1" for x, y in rows] + [f"{len(face)} {corners}"]
        return header + "\n".join(lines).encode()
    places = np.array([[x, y, 1] for x, y in rows], "<f4").tobytes()
    return header + places + bytes([len(face)]) + np.array(face, "<i4").tobytes()


NOTCHED = "-1 -1,1 -1,0 0,1 1,-1 1"


@pytest.mark.parametrize("form", ["ascii", "binary_little_endian"])
def test_concave_face_gives_a_warning(tmp_path: Path, form: str):
    path = tmp_path / "a.ply"
    path.write_bytes(_polygon(NOTCHED, "1 2 3 4 0", form))
    with pytest.warns(UserWarning, match="a.ply: 1 concave faces are cut wrongly. Triangulate"):
        sources.mesh_parts(path)
    path.write_bytes(_polygon(NOTCHED, "2 3 4 0 1", form))  # A fan about the notch covers it.
    assert sum(len(mesh.faces) for _, mesh in sources.mesh_parts(path)) == 3
