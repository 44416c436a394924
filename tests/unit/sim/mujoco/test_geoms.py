"""Triangles of MuJoCo's geoms: closed, outward, and where MuJoCo draws them."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import pytest
import trimesh

from starling.sim.mujoco import geoms

SOLIDS = {  # Volume [m^3].
    "box": 8 * 0.1 * 0.06 * 0.08,
    "capsule": np.pi * 0.06**2 * 0.2 + 4 / 3 * np.pi * 0.06**3,
    "lid": np.pi * 0.06**2 * 0.2,
    "egg": 4 / 3 * np.pi * 0.06 * 0.1 * 0.08,
}


def _solid(model: Any, name: str) -> tuple[trimesh.Trimesh, Any]:
    mesh = geoms.triangles(model, model.geom(name).id)
    return trimesh.Trimesh(mesh.vertices, mesh.faces, process=True, merge_norm=True), mesh


@pytest.mark.parametrize("name", SOLIDS)
def test_solids_are_closed_and_have_their_volume(model, name):
    solid, _ = _solid(model, name)
    solid.merge_vertices(merge_norm=True, merge_tex=True)
    assert solid.is_watertight
    assert solid.volume == pytest.approx(SOLIDS[name], rel=5e-3)


@pytest.mark.parametrize("name", ["capsule", "lid", "egg"])
def test_normals_of_round_solids_are_near_those_of_their_faces(model, name):
    mesh = geoms.triangles(model, model.geom(name).id)
    flat = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).face_normals
    cosine = np.einsum("mij,mj->mi", mesh.normals[mesh.faces], flat)
    assert cosine.min() > 0.99


@pytest.mark.parametrize("radius_m", [0.02, 0.055, 0.056, 0.2])
def test_small_balls_have_fewer_triangles_and_deviate_by_a_quarter_millimetre(radius_m):
    xml = f'<mujoco><worldbody><geom type="sphere" size="{radius_m}"/></worldbody></mujoco>'
    mesh = geoms.triangles(mujoco.MjModel.from_xml_string(xml), 0)
    assert len(mesh.faces) == (1280 if radius_m <= 0.055 else 5120)
    solid = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    inner = np.einsum("ij,ij->i", solid.triangles[:, 0], solid.face_normals)
    assert radius_m - inner.min() < 2.5e-4


def test_a_height_field_is_closed_and_has_its_heights(model):
    solid, _ = _solid(model, "hills")
    assert solid.is_watertight and solid.volume > 0.2 * 0.2 * 0.02
    assert solid.bounds[1].tolist() == pytest.approx([0.1, 0.1, 0.05])
    assert solid.bounds[0].tolist() == pytest.approx([-0.1, -0.1, -0.02])


def test_planes_have_their_size_or_end_far_away(model):
    floor = geoms.triangles(model, model.geom("floor").id)
    assert np.abs(floor.vertices[:, :2]).min() == geoms.INFINITE_M
    mat = geoms.triangles(model, model.geom("mat").id)
    assert np.abs(mat.vertices).max(axis=0).tolist() == pytest.approx([0.25, 0.15, 0])


def test_a_mesh_keeps_its_texture_coordinates(model):
    mesh = geoms.triangles(model, model.geom("sheet").id)
    assert mesh.uv is not None and len(mesh.uv) == len(mesh.vertices)
    assert {tuple(place) for place in mesh.uv.tolist()} == {(0, 0), (0, 1), (1, 0), (1, 1)}
    assert len(mesh.faces) == 3
