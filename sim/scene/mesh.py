"""A mesh file (PLY, OBJ, GLB) as a scene."""

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
    """Load a mesh in metres, y up (glTF's convention), diffuse, reflectance 0.5.

    Args:
        path: the file.
        sensor: whose field the default view fits.
        world_from_left: pose of the left imager; by default it looks at the middle from the
            front (+z) and a little above, from where all of it is seen.

    Raises:
        InputError: missing, corrupt or empty file.
    """
    bodies = tuple(
        Body(name=name, mesh=solids.mesh(part, smooth=False), material=_SURFACE)
        for name, part in parts(path)
    )
    pose = _front(bodies, sensor) if world_from_left is None else world_from_left
    up = Ambient(up=(0.0, 1.0, 0.0))
    return Scene(name=path.stem, bodies=bodies, ambient=up, world_from_left=pose)


def parts(path: Path) -> list[tuple[str, trimesh.Trimesh]]:
    """Name and triangles of each part of a mesh file, placed in its frame.

    Raises:
        InputError: missing, corrupt or empty file.
    """
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


def _front(bodies: tuple[Body, ...], sensor: Sensor) -> frames.Pose:
    """View from the front, 20 degrees above, that holds the bounding sphere.

    It keeps the distance that the sensor's range and search need.
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
