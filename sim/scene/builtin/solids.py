"""Simple solids as bodies; trimesh generates the triangles."""

from __future__ import annotations

import typing

import numpy as np
import trimesh
from numpy.typing import NDArray

from starling.sim.geometry import frames
from starling.sim.scene.scene import Body, Material, Mesh


def body(
    name: str,
    solid: trimesh.Trimesh,
    material: Material,
    world_from_solid: frames.Pose | None = None,
    *,
    smooth: bool = False,
) -> Body:
    """Place a solid; `smooth` shades it as a curved surface."""
    solid = solid.copy()
    if world_from_solid is not None:
        solid.apply_transform(world_from_solid)
    return Body(name=name, mesh=mesh(solid, smooth=smooth), material=material)


def mesh(solid: trimesh.Trimesh, *, smooth: bool) -> Mesh:
    """Triangles of a trimesh, with vertex normals if `smooth`."""
    return Mesh(
        vertices=np.asarray(solid.vertices, np.float32),
        faces=np.asarray(solid.faces, np.uint32),
        normals=np.array(solid.vertex_normals, np.float32) if smooth else None,
    )


def box(size_m: tuple[float, float, float]) -> trimesh.Trimesh:
    """Box centred at the origin."""
    return trimesh.creation.box(size_m)


def plane(width_m: float, height_m: float) -> trimesh.Trimesh:
    """Rectangle at z = 0 that faces -z (a camera at the origin of an OpenCV frame)."""
    x, y = width_m / 2, height_m / 2
    corners: NDArray[np.float64] = np.array([[-x, -y, 0], [x, -y, 0], [x, y, 0], [-x, y, 0]])
    return trimesh.Trimesh(corners, [[0, 3, 2], [0, 2, 1]], process=False)


def sphere(radius_m: float) -> trimesh.Trimesh:
    """Sphere centred at the origin, with smooth outlines at a distance of 1 m."""
    return trimesh.creation.icosphere(subdivisions=4, radius=radius_m)


def cylinder(radius_m: float, height_m: float) -> trimesh.Trimesh:
    """Cylinder along z, centred at the origin."""
    return trimesh.creation.cylinder(radius=radius_m, height=height_m, sections=64)


def cup(radius_m: float, height_m: float, wall_m: float) -> trimesh.Trimesh:
    """Open tube along z, centred at the origin."""
    return trimesh.creation.annulus(
        r_min=radius_m - wall_m, r_max=radius_m, height=height_m, sections=64
    )


def ring(radius_m: float, tube_m: float) -> trimesh.Trimesh:
    """Torus about z."""
    return trimesh.creation.torus(major_radius=radius_m, minor_radius=tube_m)


def join(solids: list[trimesh.Trimesh]) -> trimesh.Trimesh:
    """Merge several solids into one."""
    return typing.cast(trimesh.Trimesh, trimesh.util.concatenate(solids))
