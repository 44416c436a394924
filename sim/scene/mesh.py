"""Scenes from mesh files (PLY, OBJ, GLB)."""

from __future__ import annotations

import logging
from pathlib import Path

import numpy as np
import trimesh

from starling.patterns import errors
from starling.sim.geometry import frames
from starling.sim.scene.builtin import solids
from starling.sim.scene.scene import Ambient, Body, Material, Scene
from starling.sim.sensor.sensor import Sensor

SUFFIXES = (".ply", ".obj", ".glb")

_SURFACE = Material(name="unnamed", reflectance=0.5)


def load(path: Path, sensor: Sensor, world_from_left: frames.Pose | None = None) -> Scene:
    """Load a mesh in metres, y up (glTF's convention), as diffuse surfaces of reflectance 0.5.

    Args:
        path: Mesh file.
        sensor: Sensor whose field of view the default pose fits.
        world_from_left: Pose of the left imager. The default looks from the front (+z) and above,
            and sees the whole mesh.

    Raises:
        InputError: if the file is missing, corrupt or empty.
    """
    bodies = tuple(
        Body(name=name, mesh=solids.mesh(part, smooth=False), material=_SURFACE)
        for name, part in parts(path)
    )
    pose = _front(bodies, sensor) if world_from_left is None else world_from_left
    up = Ambient(up=(0.0, 1.0, 0.0))
    return Scene(name=path.stem, bodies=bodies, ambient=up, world_from_left=pose)


def parts(path: Path) -> list[tuple[str, trimesh.Trimesh]]:
    """Name and triangles of each part of a mesh file, in the file's frame.

    Raises:
        InputError: if the file is missing, corrupt or empty.
    """
    logging.getLogger("trimesh").setLevel(logging.CRITICAL)  # Its errors are reported below.
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
    except Exception as error:  # The parsers of trimesh raise errors of any type.
        raise errors.refuse(
            "scene", "must be a mesh", path, f"It cannot be read: {error}"
        ) from None
    if not parts:
        raise errors.refuse("scene", "must hold triangles", path, "The mesh is empty.")
    return parts


def _front(bodies: tuple[Body, ...], sensor: Sensor) -> frames.Pose:
    """Pose in front, 20 degrees above, that sees the whole bounding sphere.

    The distance respects the sensor's nearest depth and its search range.
    """
    points = np.concatenate([body.mesh.vertices for body in bodies])
    low, high = points.min(axis=0), points.max(axis=0)
    middle = (low + high) / 2
    radius = float(np.linalg.norm(high - low)) / 2
    half = min(sensor.width / sensor.fx_px, sensor.height / sensor.fy_px) / 2
    nearest = max(sensor.post.near_m, sensor.focal_baseline_px_m / sensor.matcher.search_px)
    distance = max(radius * np.sqrt(1 + 1 / half**2), 1.2 * nearest + radius)
    away = np.array([0.0, np.sin(np.deg2rad(20)), np.cos(np.deg2rad(20))])
    eye = middle + max(distance, 1e-3) * away
    return frames.look_at(tuple(eye), tuple(middle), (0.0, 1.0, 0.0))
