"""Meshes on a table: at rest, without intersections, reproducible."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.spatial import Delaunay

from starling.patterns.errors import InputError
from starling.sim.datasets.mesh_pile import RestingMesh, scene
from starling.sim.datasets.source import Pile
from starling.sim.scene.builtin import solids
from starling.sim.scene.scene import Scene
from starling.sim.sensor import presets

SENSOR = presets.load("d435")


@pytest.fixture(scope="module")
def things(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder = tmp_path_factory.mktemp("things")
    meshes = {
        "ring": trimesh.creation.torus(0.06, 0.02),
        "box": trimesh.creation.box((0.08, 0.12, 0.05)),
        "cone": trimesh.creation.cone(0.05, 0.14),
    }
    for name, mesh in meshes.items():
        mesh.apply_translation((1.0, 2.0, 3.0)).export(folder / f"{name}.ply")
    return sorted(folder.iterdir())


def heap(things: list[Path], count: int = 8, seed: int = 3) -> Pile:
    paths = tuple(things[number % len(things)] for number in range(count))
    return Pile(
        folder=things[0].parent, paths=paths, reflectances=(0.4,) * count, seed=seed, room="table-3"
    )


def laid(
    things: list[Path], count: int = 8, seed: int = 3
) -> tuple[Scene, tuple[RestingMesh, ...]]:
    return scene(heap(things, count, seed), SENSOR)


def test_meshes_rest_on_the_table_without_intersections(things: list[Path]):
    result, lying = laid(things)
    bodies = result.bodies[-len(lying) :]
    assert [body.name for body in bodies] == [mesh.name for mesh in lying]
    for body in bodies:
        assert body.mesh.vertices[:, 1].min() == pytest.approx(0, abs=1e-6)
    circles = []
    for body in bodies:
        flat = body.mesh.vertices[:, [0, 2]].astype(float)
        middle = (flat.min(axis=0) + flat.max(axis=0)) / 2
        circles.append((middle, np.linalg.norm(flat - middle, axis=1).max()))
    for number, (middle, radius) in enumerate(circles):
        for second, wide in circles[:number]:
            assert np.linalg.norm(middle - second) > radius + wide - 1e-4


def test_every_pose_is_stable(things: list[Path]):
    """The hull's centre of mass is above its support polygon."""
    for item in laid(things, count=12)[1]:
        mesh = trimesh.load_mesh(item.path)
        hull = mesh.convex_hull.copy().apply_transform(item.world_from_mesh)
        low = hull.vertices[hull.vertices[:, 1] < 1e-5][:, [0, 2]]
        assert len(low) >= 3
        below = hull.center_mass[[0, 2]]
        assert Delaunay(low).find_simplex(below) >= 0
        rotation = item.world_from_mesh[:3, :3]
        np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-9)
        assert np.linalg.det(rotation) == pytest.approx(1)


def test_camera_sees_the_pile(things: list[Path]):
    result, lying = laid(things)
    left_from_world = np.linalg.inv(result.world_from_left)
    points = np.concatenate([body.mesh.vertices for body in result.bodies[-len(lying) :]])
    seen = points @ left_from_world[:3, :3].T + left_from_world[:3, 3]
    x = SENSOR.fx_px * seen[:, 0] / seen[:, 2] + SENSOR.cx_px
    assert (seen[:, 2] > SENSOR.focal_baseline_px_m / SENSOR.matcher.search_px).all()
    assert x.min() > 0 and x.max() < SENSOR.width
    assert x.max() - x.min() > 0.4 * SENSOR.width


def test_equal_seeds_give_equal_piles(things: list[Path]):
    item, changed = laid(things)[1], laid(things)[1]
    assert all(
        (first.world_from_mesh == second.world_from_mesh).all()
        for first, second in zip(item, changed, strict=True)
    )
    different = laid(things, seed=4)[1]
    assert not np.allclose(different[0].world_from_mesh, item[0].world_from_mesh)


def test_bodies_are_the_meshes_at_their_reported_poses(things: list[Path]):
    result, lying = laid(things, count=3)
    for body, first in zip(result.bodies[-3:], lying, strict=True):
        mesh = solids.mesh(trimesh.load_mesh(first.path), smooth=False).vertices
        placed = mesh @ first.world_from_mesh[:3, :3].T + first.world_from_mesh[:3, 3]
        np.testing.assert_allclose(
            np.sort(body.mesh.vertices, axis=0), np.sort(placed, axis=0), atol=1e-5
        )
        assert body.material.reflectance == 0.4


def test_flat_mesh_is_refused(tmp_path: Path):
    path = tmp_path / "sheet.obj"
    path.write_text("v -1 -1 1\nv 1 -1 1\nv 1 1 1\nv -1 1 1\nf 1 2 3 4\n")
    with pytest.raises(InputError, match=r"sheet.obj. It is flat: give it a thickness"):
        scene(heap([path], count=1), SENSOR)


def test_impossible_piles_are_refused(things: list[Path], tmp_path: Path):
    with pytest.raises(
        InputError, match=r"meshes must have room on a table of 2 x 1\.4 m; got 200"
    ):
        laid(things, count=200)
    flat = tmp_path / "flat.ply"
    trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]).export(flat)
    with pytest.raises(InputError, match="mesh must be a solid that can rest on a table"):
        laid([flat], count=1)
    with pytest.raises(InputError, match="scene must be a file that exists"):
        laid([tmp_path / "none.ply"], count=1)
