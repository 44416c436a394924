"""OBJ files that contradict themselves are refused; what is not read gives a warning."""

import re
from pathlib import Path

import pytest

from starling.patterns import InputError
from starling.sim.scene import sources

SQUARE = "v -1 -1 1\nv 1 -1 1\nv 1 1 1\nv -1 1 1\n"
NOTCHED = "v -1 -1 1\nv 1 -1 1\nv 0 0 1\nv 1 1 1\nv -1 1 1\n"
REFUSED = [
    ("f 0 1 2\nf 1 2 3\n", "a face has the vertex 0, which is missing"),
    ("f -5 1 2\n", "a face has the vertex -5, which is missing"),
    ("f 1 2 5\n", "a triangle has a vertex that is missing"),
    ("f 1 2\nf 1 2 3\n", "a face has 2 vertices"),
    ("f 1 2 3\nf\t1 3 4\n", "a line starts with 'f\\t', not 'f' and a space"),
    ("f 1 2 3.5\n", "invalid literal for int"),
]


def count_triangles(path: Path) -> int:
    return sum(len(mesh.faces) for _, mesh in sources.mesh_parts(path))


@pytest.mark.parametrize(("faces", "reason"), REFUSED)
def test_contradicting_file_is_refused(tmp_path: Path, faces: str, reason: str):
    path = tmp_path / "a.obj"
    path.write_text(SQUARE + faces)
    with pytest.raises(InputError, match=re.escape(f"a.obj. It cannot be read: {reason}")):
        sources.mesh_parts(path)


@pytest.mark.parametrize(
    "faces",
    [
        "f 1 2 3 4\n",
        "f 1/1/1 2/1/1 3//1 4\n",
        "f -4 -3 -2 -1\n",
        "f 1 2 \\\n3 4\n",
        "g f\nf 1 2 3 4",
    ],
)
def test_correct_file_is_read_without_a_warning(tmp_path: Path, faces: str):
    path = tmp_path / "a.obj"
    path.write_text(SQUARE + faces)
    assert count_triangles(path) == 2


def test_faces_bent_out_of_plane_are_no_concave_ones(tmp_path: Path):
    path = tmp_path / "a.obj"
    path.write_text(SQUARE.replace("-1 1 1\n", "-1 1 1.5\n") + "f 1 2 3 4\n")
    assert count_triangles(path) == 2


@pytest.mark.parametrize("face", ["f 1 2 3 4 5\n", "f 3 4 5 1 2\n"])
def test_concave_face_that_a_fan_covers_is_read_without_a_warning(tmp_path: Path, face: str):
    path = tmp_path / "a.obj"
    path.write_text(NOTCHED + face)
    assert count_triangles(path) == 3


@pytest.mark.parametrize("face", ["f 2 3 4 5 1\n", "f 4 5 1 2 3\n"])
def test_concave_face_gives_a_warning(tmp_path: Path, face: str):
    path = tmp_path / "a.obj"
    path.write_text(NOTCHED + face)
    with pytest.warns(UserWarning, match="a.obj: 1 concave faces are cut wrongly. Triangulate"):
        sources.mesh_parts(path)


def test_free_form_surface_gives_a_warning(tmp_path: Path):
    path = tmp_path / "a.obj"
    path.write_text(SQUARE + "surf 0 1 0 1 1 2 3 4\nf 1 2 3 4\n")
    with pytest.warns(UserWarning, match="a.obj: surf not used; triangles only. Convert them"):
        sources.mesh_parts(path)
