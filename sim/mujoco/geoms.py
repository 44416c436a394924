"""Triangles of MuJoCo's geoms, in the geom's frame, with coordinates into their textures."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

from starling.sim.mujoco.library import mujoco
from starling.sim.scene.scene import Mesh

INFINITE_M = 50.0  # Half the side of a plane without a size [m].
_SIDES = 48  # Of round solids; 1 m across, they deviate by 1 mm.
_COARSE_M = 2.5e-4  # Largest deviation of a coarse ball; fewer triangles are faster [m].
_COARSE_BALL = 4.53e-3  # Relative deviation of an icosphere of three subdivisions.
_Points = NDArray[np.float64]


def names() -> dict[int, str]:
    """Kinds of geoms that have triangles, by MuJoCo's number of the kind."""
    return {int(kind): kind.name.removeprefix("mjGEOM_") for kind in _builders(mujoco().mjtGeom)}


def triangles(model: Any, geom: int) -> Mesh:
    """Triangles of a geom in its frame [m]; `uv` only if its mesh has texture coordinates.

    Args:
        model: `mujoco.MjModel`.
        geom: number of a geom whose kind is one of `names`.
    """
    kind = mujoco().mjtGeom(int(model.geom_type[geom]))
    return _builders(mujoco().mjtGeom)[kind](model, geom)


def _builders(kinds: Any) -> dict[Any, Callable[[Any, int], Mesh]]:
    return {
        kinds.mjGEOM_PLANE: _plane,
        kinds.mjGEOM_BOX: _box,
        kinds.mjGEOM_SPHERE: _ellipsoid,
        kinds.mjGEOM_ELLIPSOID: _ellipsoid,
        kinds.mjGEOM_CYLINDER: _cylinder,
        kinds.mjGEOM_CAPSULE: _capsule,
        kinds.mjGEOM_MESH: _mesh,
        kinds.mjGEOM_SDF: _mesh,
        kinds.mjGEOM_HFIELD: _height_field,
    }


def half_sizes(model: Any, geom: int) -> NDArray[np.float64]:
    """Scale (3,) of the unit solid that MuJoCo draws for a geom; 0 where a plane has no end."""
    size, kinds = np.array(model.geom_size[geom], np.float64), mujoco().mjtGeom
    kind = int(model.geom_type[geom])
    if kind == kinds.mjGEOM_SPHERE:
        return np.full(3, size[0])
    if kind in (kinds.mjGEOM_CYLINDER, kinds.mjGEOM_CAPSULE):
        return size[[0, 0, 1]]
    return size


def _flat(solid: trimesh.Trimesh) -> Mesh:
    return Mesh(
        vertices=np.asarray(solid.vertices, np.float32), faces=np.asarray(solid.faces, np.uint32)
    )


def _plane(model: Any, geom: int) -> Mesh:
    x, y = (side if side > 0 else INFINITE_M for side in model.geom_size[geom][:2].tolist())
    corners = [[-x, -y, 0], [x, -y, 0], [x, y, 0], [-x, y, 0]]
    return Mesh(
        vertices=np.array(corners, np.float32), faces=np.array([[0, 1, 2], [0, 2, 3]], np.uint32)
    )


def _box(model: Any, geom: int) -> Mesh:
    return _flat(trimesh.creation.box(2 * model.geom_size[geom]))


def _cylinder(model: Any, geom: int) -> Mesh:
    radius, half = model.geom_size[geom][:2].tolist()
    solid = trimesh.creation.cylinder(radius, 2 * half, sections=_SIDES)
    # Faces of the wall are smooth, those of the lids flat: their vertices are not shared.
    corners = solid.triangles.reshape(-1, 3)
    flat = np.repeat(solid.face_normals, 3, axis=0)
    outward = corners * [1, 1, 0] / radius
    wall = np.abs(flat[:, 2:]) < 0.5
    normals = np.where(wall, outward, flat)
    return Mesh(
        vertices=corners.astype(np.float32),
        faces=np.arange(len(corners), dtype=np.uint32).reshape(-1, 3),
        normals=normals.astype(np.float32),
    )


def _capsule(model: Any, geom: int) -> Mesh:
    radius, half = model.geom_size[geom][:2].tolist()
    solid = trimesh.creation.capsule(2 * half, radius, count=[_SIDES // 2, _SIDES])
    vertices = np.asarray(solid.vertices, np.float64)
    axis = np.clip(vertices[:, 2:], -half, half) * [0, 0, 1]
    return _round(vertices, solid.faces, vertices - axis)


def _ellipsoid(model: Any, geom: int) -> Mesh:
    half = half_sizes(model, geom)
    coarse = half.max() * _COARSE_BALL <= _COARSE_M
    ball = trimesh.creation.icosphere(subdivisions=3 if coarse else 4)
    return _round(ball.vertices * half, ball.faces, ball.vertices / half)


def _round(vertices: _Points, faces: NDArray[Any], normals: _Points) -> Mesh:
    """A smooth solid; normals of any length."""
    unit = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    return Mesh(
        vertices=np.asarray(vertices, np.float32),
        faces=np.asarray(faces, np.uint32),
        normals=unit.astype(np.float32),
    )


def _mesh(model: Any, geom: int) -> Mesh:
    """A mesh of the model; a corner of its faces has its own normal and texture coordinate."""
    number = int(model.geom_dataid[geom])
    first, count = int(model.mesh_faceadr[number]), int(model.mesh_facenum[number])
    rows = slice(first, first + count)
    corners = [model.mesh_face[rows].ravel(), model.mesh_facenormal[rows].ravel()]
    textured = int(model.mesh_texcoordadr[number]) >= 0
    if textured:
        corners.append(model.mesh_facetexcoord[rows].ravel())
    unique, faces = np.unique(np.stack(corners, axis=1), axis=0, return_inverse=True)
    block = partial(_block, model, number)
    return Mesh(
        vertices=block("vert")[unique[:, 0]],
        faces=faces.reshape(-1, 3).astype(np.uint32),
        normals=block("normal")[unique[:, 1]],
        uv=block("texcoord")[unique[:, 2]] if textured else None,
    )


def _block(model: Any, number: int, name: str) -> NDArray[np.float32]:
    first = int(getattr(model, f"mesh_{name}adr")[number])
    count = int(getattr(model, f"mesh_{name}num")[number])
    return np.array(getattr(model, f"mesh_{name}")[first : first + count], np.float32)


def _height_field(model: Any, geom: int) -> Mesh:
    """A height field with walls down to its base."""
    number = int(model.geom_dataid[geom])
    rows, columns = int(model.hfield_nrow[number]), int(model.hfield_ncol[number])
    half_x, half_y, rise, base = model.hfield_size[number].tolist()
    first = int(model.hfield_adr[number])
    data = model.hfield_data[first : first + rows * columns].reshape(rows, columns)
    x, y = np.meshgrid(np.linspace(-half_x, half_x, columns), np.linspace(-half_y, half_y, rows))
    top = np.stack([x, y, rise * data], axis=-1).reshape(-1, 3)
    index = np.arange(rows * columns).reshape(rows, columns)
    faces = _squares(index)
    edge = np.concatenate([index[0], index[1:, -1], index[-1, -2::-1], index[-2:0:-1, 0]])
    below = top[edge] * [1, 1, 0] - [0, 0, base]
    ring = np.append(np.arange(len(edge)), 0)
    wall = _squares(np.stack([len(top) + ring, edge[ring]]))
    middle = len(top) + len(edge)
    pairs = len(top) + np.stack([ring[1:], ring[:-1]], axis=1)
    bottom = np.concatenate([np.full((len(edge), 1), middle), pairs], axis=1)
    return Mesh(
        vertices=np.concatenate([top, below, [[0, 0, -base]]]).astype(np.float32),
        faces=np.concatenate([faces, wall, bottom]).astype(np.uint32),
    )


def _squares(index: NDArray[np.integer]) -> NDArray[np.integer]:
    """Two triangles for each square of a grid of vertices, counter-clockwise with y up."""
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
    return np.concatenate(
        [np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)]
    )
