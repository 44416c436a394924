"""Colours and normals of the vertices of mesh files, and files without any colour."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from starling.patterns import InputError
from starling.sim.scene import colours
from starling.sim.scene.meshes import appearance
from tests.unit.sim.square import (
    CORNERS,
    FACES,
    load,
    only,
)


@pytest.mark.parametrize("suffix", [".ply", ".obj", ".glb", ".stl"])
def test_files_without_colour_keep_their_reflectance(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"box{suffix}"
    trimesh.creation.box((0.2, 0.2, 0.2)).export(path)
    body = only(path)
    assert (body.material.reflectance, body.material.rgb, body.colour) == (0.5, None, None)
    assert body.mesh.normals is None


@pytest.mark.parametrize("suffix", [".ply", ".obj"])
def test_vertex_colours_are_linear_over_triangles(tmp_path: Path, suffix: str) -> None:
    """Bilinear interpolation at the centre of a triangle gives the mean of its corners."""
    square = trimesh.Trimesh(CORNERS, FACES, process=False)
    levels = np.array(
        [(150, 200, 130), (190, 150, 140), (170, 180, 190), (160, 140, 160)], np.uint8
    )
    square.visual.vertex_colors = levels  # type: ignore[union-attr]
    square.export(tmp_path / f"m{suffix}")
    body = only(tmp_path / f"m{suffix}")
    assert body.colour is not None and body.mesh.uv is not None and not body.repeats
    height, width = body.colour.shape[:2]
    linear = colours.linear(levels)
    by_place = {
        tuple(np.round(corner, 4)): rgb for corner, rgb in zip(CORNERS, linear, strict=True)
    }
    for face in body.mesh.faces:
        expected = np.mean(
            [by_place[tuple(np.round(v.astype(float), 4))] for v in body.mesh.vertices[face]],
            axis=0,
        )
        x, y = body.mesh.uv[face].mean(axis=0) * (width, height) - 0.5
        left, top = int(x), int(y)
        a, b = x - left, y - top
        square_px = body.colour[top : top + 2, left : left + 2]
        rows = square_px[0] * (1 - b) + square_px[1] * b
        centre = rows[0] * (1 - a) + rows[1] * a
        np.testing.assert_allclose(centre, expected, atol=1e-4)


def test_equal_vertex_colours_are_a_material(tmp_path: Path) -> None:
    square = trimesh.Trimesh(CORNERS, FACES, process=False)
    square.visual.vertex_colors = np.full((4, 3), 188, np.uint8)  # type: ignore[union-attr]
    square.export(tmp_path / "m.ply")
    body = only(tmp_path / "m.ply")
    assert body.colour is None
    assert body.material.rgb == pytest.approx((0.503, 0.503, 0.503), abs=1e-3)


def test_face_colours_of_a_ply(tmp_path: Path) -> None:
    square = trimesh.Trimesh(CORNERS, FACES, process=False)
    square.visual.face_colors = [(255, 0, 0, 255), (0, 0, 255, 255)]  # type: ignore[union-attr]
    square.export(tmp_path / "m.ply")
    body = only(tmp_path / "m.ply")
    assert body.colour is not None
    assert {tuple(pixel) for pixel in body.colour.reshape(-1, 3)} == {(1, 0, 0), (0, 0, 1)}


def test_vertex_colours_of_a_glb_are_linear(tmp_path: Path) -> None:
    square = trimesh.Trimesh(CORNERS, FACES, process=False)
    square.visual.vertex_colors = np.full((4, 3), 51, np.uint8)  # type: ignore[union-attr]
    square.export(tmp_path / "m.glb")
    assert only(tmp_path / "m.glb").material.rgb == pytest.approx((0.2, 0.2, 0.2))


def test_a_ply_names_a_missing_picture(tmp_path: Path) -> None:
    data = trimesh.creation.box((0.1, 0.1, 0.1)).export(file_type="ply", encoding="ascii")
    assert isinstance(data, bytes)
    named = data.replace(b"ascii 1.0\n", b"ascii 1.0\ncomment TextureFile skin.png\n")
    (tmp_path / "m.ply").write_bytes(named)
    with pytest.warns(UserWarning, match=r"files that are missing \(skin\.png\)"):
        load(tmp_path / "m.ply")


@pytest.mark.parametrize("suffix", [".glb", ".ply", ".obj"])
def test_vertex_normals_of_a_file_shade_smoothly(tmp_path: Path, suffix: str) -> None:
    ball = trimesh.creation.icosphere(2, 0.1)
    kind = suffix.removeprefix(".")
    names = {"glb": "include_normals", "ply": "vertex_normal", "obj": "include_normals"}
    ball.export(tmp_path / f"ball{suffix}", file_type=kind, **{names[kind]: True})
    mesh = only(tmp_path / f"ball{suffix}").mesh
    assert mesh.normals is not None
    np.testing.assert_allclose(mesh.normals, mesh.vertices / 0.1, atol=0.02)


def test_normals_without_a_length_are_left_out(tmp_path: Path) -> None:
    text = "".join(f"v {x} {y} {z}\n" for x, y, z in CORNERS) + "vn 0 0 0\nvn 0 0 1\n"
    (tmp_path / "m.obj").write_text(text + "f 1//1 2//2 3//2\n")
    assert only(tmp_path / "m.obj").mesh.normals is None


def test_vertices_in_a_plane_are_refused(tmp_path: Path) -> None:
    (tmp_path / "m.obj").write_text("v 0 0\nv 1 0\nv 0 1\nf 1 2 3\n")
    with pytest.raises(InputError, match="It cannot be read: its vertices have 2 coordinates"):
        load(tmp_path / "m.obj")


def test_large_pictures_are_reduced(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(appearance, "LARGEST_PX", 8)
    assert appearance.reduced(np.zeros((4, 32, 3), np.uint8)).shape == (1, 8, 3)
    assert appearance.reduced(np.zeros((8, 4, 3), np.uint8)).shape == (8, 4, 3)
