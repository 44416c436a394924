"""Coordinates into the textures of MuJoCo's geoms, as its classic renderer has them.

Since version 4, solids have coordinates of their own; before, all flat textures were projected.
Starling's uv (0, 0) is the corner of an image's first pixel; so is that of MuJoCo.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

from starling.sim.mujoco import geoms
from starling.sim.mujoco.library import mujoco
from starling.sim.scene.scene import Mesh

# Axes (s, t) and their signs on the faces of a cube map, in the order of its images (OpenGL 4.6
# core profile, table 8.19).
_CUBE = {
    (0, 1): ((2, -1), (1, -1)),
    (0, -1): ((2, 1), (1, -1)),
    (1, 1): ((0, 1), (2, 1)),
    (1, -1): ((0, 1), (2, -1)),
    (2, 1): ((0, 1), (1, -1)),
    (2, -1): ((0, -1), (1, -1)),
}
_SUBDIVISIONS = 4
_Points = NDArray[np.float64]


def on_image(model: Any, geom: int, mesh: Mesh) -> Mesh:
    """Give a mesh the coordinates of a flat texture.

    Args:
        model: `mujoco.MjModel`.
        geom: number of the geom.
        mesh: its triangles; coordinates of its own are scaled.
    """
    kinds, kind = mujoco().mjtGeom, int(model.geom_type[geom])
    material, half = int(model.geom_matid[geom]), geoms.half_sizes(model, geom)
    repeat = np.array(model.mat_texrepeat[material], np.float64)
    if model.mat_texuniform[material]:
        repeat = repeat * np.where(half[:2] > 0, half[:2], 1)
    solids_projected = int(mujoco().__version__.split(".")[0]) < 4
    if mesh.uv is not None:
        scale = np.ones(2) if solids_projected else repeat
        return dataclasses.replace(mesh, uv=(mesh.uv * scale).astype(np.float32))
    meshes = (kinds.mjGEOM_MESH, kinds.mjGEOM_SDF, kinds.mjGEOM_HFIELD)
    if solids_projected or kind in meshes:
        place = mesh.vertices[:, :2] / np.where(half[:2] > 0, half[:2], 1)
        uv = place * (0.5 * repeat * [1, -1]) - 0.5
        return dataclasses.replace(mesh, uv=uv.astype(np.float32))
    if kind == kinds.mjGEOM_PLANE:
        place = mesh.vertices[:, :2] / np.where(half[:2] > 0, half[:2], 1) * [1, -1] / 2
        uv = (place + 0.5) * repeat if (half[:2] > 0).all() else place * repeat - 0.5
        return dataclasses.replace(mesh, uv=uv.astype(np.float32))
    unrolled = _unroll(mesh)
    corners = unrolled.vertices.reshape(-1, 3, 3).astype(np.float64)
    if kind == kinds.mjGEOM_BOX:
        uv = _on_box(corners / half)
    elif kind in (kinds.mjGEOM_SPHERE, kinds.mjGEOM_ELLIPSOID):
        uv = _around(corners / half, _elevation(corners / half))
    elif kind == kinds.mjGEOM_CYLINDER:
        uv = _on_cylinder(corners / half)
    else:
        uv = _on_capsule(corners / half[0], half[2] / half[0])
    return dataclasses.replace(unrolled, uv=(uv.reshape(-1, 2) * repeat).astype(np.float32))


def on_cube(model: Any, geom: int, mesh: Mesh, *, single: bool) -> Mesh:
    """Give each triangle the coordinates of one face of a cube map.

    Args:
        model: `mujoco.MjModel`.
        geom: number of the geom.
        mesh: its triangles.
        single: whether one image is on all faces; otherwise six are on top of each other.
    """
    kinds, half = mujoco().mjtGeom, geoms.half_sizes(model, geom)
    uniform = bool(model.mat_texuniform[int(model.geom_matid[geom])])
    scale = np.ones(3)
    if int(model.geom_type[geom]) in (kinds.mjGEOM_MESH, kinds.mjGEOM_SDF, kinds.mjGEOM_HFIELD):
        scale = half if uniform else scale
    elif not uniform:
        scale = 1 / np.where(half > 0, half, 1)
    if uniform and mesh.normals is None:
        mesh = _subdivide(mesh)
    unrolled = _unroll(mesh)
    corners = unrolled.vertices.reshape(-1, 3, 3) * scale
    middle = corners.mean(axis=1)
    axis = np.abs(middle).argmax(axis=1)
    positive = np.take_along_axis(middle, axis[:, None], axis=1)[:, 0] >= 0
    uv = np.zeros((*corners.shape[:2], 2))
    for number, ((main, sign), ((s, s_sign), (t, t_sign))) in enumerate(_CUBE.items()):
        chosen = (axis == main) & (positive == (sign > 0))
        part = corners[chosen]
        depth = np.maximum(np.abs(part[..., main]), 1e-9)
        place = np.stack([s_sign * part[..., s], t_sign * part[..., t]], axis=-1)
        place = np.clip(place / depth[..., None], -1, 1) / 2 + 0.5
        if not single:
            place[..., 1] = (number + place[..., 1]) / len(_CUBE)
        uv[chosen] = place
    return dataclasses.replace(unrolled, uv=uv.reshape(-1, 2).astype(np.float32))


def _subdivide(mesh: Mesh) -> Mesh:
    """A flat mesh with small triangles: one side of a long box may show several faces."""
    vertices, faces = mesh.vertices, mesh.faces
    for _ in range(_SUBDIVISIONS):
        vertices, faces = trimesh.remesh.subdivide(vertices, faces)[:2]
    return Mesh(vertices=vertices.astype(np.float32), faces=faces.astype(np.uint32))


def _unroll(mesh: Mesh) -> Mesh:
    """The mesh with corners that no triangles share."""
    flat = mesh.faces.ravel()
    return Mesh(
        vertices=mesh.vertices[flat],
        faces=np.arange(len(flat), dtype=np.uint32).reshape(-1, 3),
        normals=None if mesh.normals is None else mesh.normals[flat],
    )


def _on_box(corners: _Points) -> _Points:
    """Coordinates (m, 3, 2) on the faces of a cube from -1 to 1; corners (m, 3, 3)."""
    x, y, z = np.moveaxis(corners, -1, 0)
    axis = np.abs(corners.mean(axis=1)).argmax(axis=1)[:, None]
    u, v = np.where(axis == 0, y, x), np.where(axis == 2, y, z)
    return np.stack([(u + 1) / 2, (1 - v) / 2], axis=-1)


def _around(corners: _Points, v: _Points) -> _Points:
    """Coordinates with the azimuth as u, whole triangles on one side of its seam."""
    x, y = corners[..., 0], corners[..., 1]
    u = np.arctan2(y, x) / (2 * np.pi) % 1.0
    u = np.where((np.ptp(u, axis=1, keepdims=True) > 0.5) & (u < 0.5), u + 1, u)
    pole = np.hypot(x, y) < 1e-6
    others = np.where(pole, 0, u).sum(axis=1, keepdims=True)
    count = np.maximum((~pole).sum(axis=1, keepdims=True), 1)
    return np.stack([np.where(pole, others / count, u), v], axis=-1)


def _elevation(corners: _Points) -> _Points:
    """v from 0 at the upper pole of a sphere to 1 at the lower one."""
    return 0.5 - np.arcsin(np.clip(corners[..., 2], -1, 1)) / np.pi


def _on_cylinder(corners: _Points) -> _Points:
    """Coordinates on a cylinder from -1 to 1: around its wall, and across its lids."""
    wall = _around(corners, (1 - corners[..., 2]) / 2)
    height = corners[..., 2].max(axis=1) - corners[..., 2].min(axis=1)
    lid = (height < 1e-6)[:, None, None]
    return np.where(lid, corners[..., :2] / 2 + 0.5, wall)


def _on_capsule(corners: _Points, half: float) -> _Points:
    """Coordinates on a capsule of radius 1: wall and caps each run through the texture."""
    z = corners[..., 2]
    on_wall = np.abs(z).max(axis=1, keepdims=True) <= half + 1e-6
    cap = _elevation(corners - np.sign(z)[..., None] * [0, 0, half])
    return _around(corners, np.where(on_wall, (1 - z / half) / 2, cap))
