"""A mesh file (PLY, OBJ, GLB) as a scene."""

from __future__ import annotations

import logging
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray

from patterns import errors
from sim import frames
from sim.scene import Body, Material, Scene
from sim.scenes import solids
from sim.sensor import Sensor

SUFFIXES = (".ply", ".obj", ".glb")

_LARGEST_M = 100.0
_SURFACE = Material(name="unnamed", reflectance=0.5)


def load(path: Path, sensor: Sensor, world_from_left: frames.Pose | None = None) -> Scene:
    """Load a mesh in metres, y up (glTF's convention), diffuse, reflectance 0.5.

    Args:
        path: the file.
        sensor: whose field the default view fits.
        world_from_left: pose of the left imager; by default it looks at the middle from the
            front (+z) and a little above, from where all of it is seen.

    Raises:
        InputError: missing, corrupt or empty file, not metres, or the camera inside a body.
    """
    bodies = tuple(
        Body(name=name, mesh=solids.mesh(part, smooth=False), material=_SURFACE)
        for name, part in _parts(path)
    )
    points = np.concatenate([body.mesh.vertices for body in bodies])
    low, high = points.min(axis=0), points.max(axis=0)
    extent = float((high - low).max())
    if extent > _LARGEST_M:
        raise errors.refuse(
            "mesh extent",
            f"must be at most {_LARGEST_M:g} m",
            f"{extent:g} m in {path}",
            "It looks like millimetres: scale the mesh by 0.001.",
        )
    if extent == 0:
        raise errors.refuse("mesh extent", "must be > 0", f"0 m in {path}", "Is it a point?")
    pose = _front(low, high, sensor) if world_from_left is None else world_from_left
    for body in bodies:
        if winding_number(body, pose[:3, 3]) > 0.5:
            raise errors.refuse(
                "camera",
                "must stand outside every body",
                f"{np.round(pose[:3, 3], 3).tolist()} inside {body.name}",
                "Move it, or turn the normals of a room inwards.",
            )
    return Scene(name=path.stem, bodies=bodies, world_from_left=pose)


def _parts(path: Path) -> list[tuple[str, trimesh.Trimesh]]:
    logging.getLogger("trimesh").setLevel(logging.CRITICAL)  # Its refusals are ours below.
    if not path.is_file():
        raise errors.refuse("scene", "must be a file that exists", path, "Check the path.")
    try:
        loaded = trimesh.load_scene(path, process=False)
        parts = [
            (str(name), mesh.copy().apply_transform(loaded.graph.get(node)[0]))
            for node in loaded.graph.nodes_geometry
            for name in [loaded.graph[node][1]]
            for mesh in [loaded.geometry[name]]
            if isinstance(mesh, trimesh.Trimesh) and len(mesh.faces)
        ]
    except Exception as error:  # trimesh raises what its parsers meet, of any type.
        raise errors.refuse(
            "scene", "must be a mesh", path, f"It cannot be read: {error}"
        ) from None
    if not parts:
        raise errors.refuse("scene", "must hold triangles", path, "The mesh is empty.")
    return parts


def _front(low: NDArray, high: NDArray, sensor: Sensor) -> frames.Pose:
    """View from the front, 20 degrees above, that holds the bounding sphere."""
    middle = (low + high) / 2
    radius = float(np.linalg.norm(high - low)) / 2
    half = min(sensor.width / sensor.fx_px, sensor.height / sensor.fy_px) / 2
    distance = radius * np.sqrt(1 + 1 / half**2)
    away = np.array([0.0, np.sin(np.deg2rad(20)), np.cos(np.deg2rad(20))])
    eye = middle + distance * away
    return frames.look_at(tuple(eye), tuple(middle), (0.0, 1.0, 0.0))


def winding_number(body: Body, point: NDArray) -> float:
    """How often a body's surface winds around a point: 1 inside a closed one, 0 outside.

    Source: van Oosterom and Strackee, The solid angle of a plane triangle, 1983, eq. 8.
    """
    corners = body.mesh.vertices[body.mesh.faces].astype(np.float64) - point
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    la, lb, lc = (np.linalg.norm(side, axis=1) for side in (a, b, c))
    triple = np.einsum("ij,ij->i", a, np.cross(b, c))
    below = (
        la * lb * lc
        + np.einsum("ij,ij->i", a, b) * lc
        + np.einsum("ij,ij->i", b, c) * la
        + np.einsum("ij,ij->i", c, a) * lb
    )
    return float(np.arctan2(triple, below).sum() / (2 * np.pi))
