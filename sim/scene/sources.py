"""Loading of scenes by specifier: builtin name, mesh, Mitsuba XML or real capture."""

from __future__ import annotations

import logging
import os
import warnings
from pathlib import Path

import numpy as np
import trimesh
from trimesh.resolvers import FilePathResolver

from starling.patterns import errors
from starling.sim.geometry import frames
from starling.sim.scene import gltf, mitsuba_xml, obj, ply
from starling.sim.scene.builtin import solids
from starling.sim.scene.scene import Ambient, Body, Material, Scene, Sun
from starling.sim.sensor.sensor import Sensor

MESH_SUFFIXES = (".ply", ".obj", ".glb")

_CONVERTIBLE = (
    ".gltf",
    ".stl",
    ".dae",
    ".fbx",
    ".off",
    ".usd",
    ".usda",
    ".usdc",
    ".usdz",
    ".blend",
)
_LARGEST_M = 100.0  # Largest extent of a mesh; larger ones are not in metres [m].
_USUAL_M = (0.005, 30.0)  # Extents of objects and rooms; others give a warning [m].
_NEAR_M = 1000.0  # Largest coordinate of a mesh that is not shifted to the origin [m].
_SURFACE = Material(name="unnamed", reflectance=0.5)


def load(specifier: str, sensor: Sensor) -> Scene:
    """Load the scene of a specifier.

    Args:
        specifier: One of the following. A builtin name: `wall`, `staircase`, `tabletop`, `clutter`
            or `room`, also as NAME:NUMBER with a distance in metres or a seed. A mesh file: `.ply`,
            `.obj` or `.glb`. A Mitsuba `.xml`. The folder of a scene in a capture set.
        sensor: Sensor whose field of view a mesh's default pose fits.

    Raises:
        InputError: if the specifier is unknown, or the scene is refused.
    """
    from starling.sim.scene.builtin import scenes
    from starling.sim.scene.captured import captured_scene

    name, _, number = specifier.partition(":")
    if name in scenes.BUILTIN:
        return scenes.named(name, number)
    path = Path(specifier)
    if path.suffix.lower() in MESH_SUFFIXES:
        return load_mesh(path, sensor)
    if path.suffix.lower() == ".xml":
        return mitsuba_xml.load(path)
    if os.path.isdir(path):  # Unlike `is_dir`, it bears names that are too long.
        return captured_scene.load(path, sensor)
    if path.suffix.lower() in _CONVERTIBLE:
        advice = "Convert it to GLB, for example with Blender or trimesh."
        rule = f"must be one of {', '.join(MESH_SUFFIXES)} or .xml"
        raise errors.refuse("scene", rule, path, advice)
    known = f"Builtin: {', '.join(scenes.BUILTIN)}; meshes: {', '.join(MESH_SUFFIXES)}."
    if not os.path.exists(path) and "/" not in specifier:
        errors.one_of("scene", name, scenes.BUILTIN)
    raise errors.refuse(
        "scene",
        "must be a builtin name, a mesh, a Mitsuba XML or a capture",
        repr(specifier),
        known,
    )


def load_mesh(path: Path, sensor: Sensor, world_from_left: frames.Pose | None = None) -> Scene:
    """Load a mesh in metres, y up (glTF's convention), as diffuse surfaces of reflectance 0.5.

    Args:
        path: Mesh file.
        sensor: Sensor whose field of view the default pose fits.
        world_from_left: Pose of the left imager. The default looks from the front (+z) and above,
            and sees the whole mesh.

    Raises:
        InputError: if the file is missing, corrupt or empty.
    """
    parts = mesh_parts(path)
    _check_size(parts, path)
    origin = _origin(parts)
    bodies = tuple(
        Body(name=name, mesh=solids.mesh(part, smooth=False), material=_SURFACE)
        for name, part in ((name, part.apply_translation(-origin)) for name, part in parts)
    )
    pose = _front(bodies, sensor)
    if world_from_left is not None:
        pose = world_from_left.copy()
        pose[:3, 3] -= origin
    x, y, z = origin.tolist()
    return Scene(
        name=path.stem,
        bodies=bodies,
        ambient=Ambient(up=(0.0, 1.0, 0.0)),
        sun=Sun(towards=mitsuba_xml.SUN_Y_UP),
        world_from_left=pose,
        origin_m=(x, y, z),
    )


def refuse_mesh(path: Path) -> None:
    """Refuse a mesh file that cannot be loaded or is not in metres; warn of an unusual size.

    Raises:
        InputError: as `load_mesh`.
    """
    _check_size(mesh_parts(path), path)


def _bounds(parts: list[tuple[str, trimesh.Trimesh]]) -> tuple[np.ndarray, np.ndarray]:
    points = np.concatenate([np.asarray(part.vertices, np.float64) for _, part in parts])
    return points.min(axis=0), points.max(axis=0)


def _check_size(parts: list[tuple[str, trimesh.Trimesh]], path: Path) -> None:
    """Refuse a mesh that cannot be in metres, and warn of an unusual size."""
    low, high = _bounds(parts)
    extent = float((high - low).max())
    if not np.isfinite([low, high]).all():
        rule, advice = "must have finite vertices", "Export it again."
        raise errors.refuse("mesh", rule, f"NaN or infinite ones in {path}", advice)
    if extent > _LARGEST_M:
        rule = f"must be at most {_LARGEST_M:g} m wide"
        advice = "It looks like millimetres: scale the mesh by 0.001."
        raise errors.refuse("mesh", rule, f"{extent:g} m in {path}", advice)
    farthest_m = float(np.abs([low, high]).max())
    if farthest_m > frames.FARTHEST_M:
        rule = f"must lie within {frames.FARTHEST_M:g} m of its origin"
        got = f"a coordinate of {farthest_m:g} m in {path}"
        raise errors.refuse("mesh", rule, got, "Subtract an offset from all vertices.")
    if not _USUAL_M[0] <= extent <= _USUAL_M[1]:
        warnings.warn(
            f"{path} is {extent:.3g} m wide: meshes are read in metres. Scale it if that is wrong.",
            stacklevel=3,
        )


def _origin(parts: list[tuple[str, trimesh.Trimesh]]) -> np.ndarray:
    """Return the point (3,) that becomes the world's origin; 0 for meshes near it."""
    low, high = _bounds(parts)
    if np.abs([low, high]).max() <= _NEAR_M:
        return np.zeros(3)
    return np.round((low + high) / 2)


def mesh_parts(path: Path) -> list[tuple[str, trimesh.Trimesh]]:
    """Name and triangles of each part of a mesh file, in the file's frame.

    Raises:
        InputError: if the file is missing, corrupt or empty.
    """
    logging.getLogger("trimesh").setLevel(logging.CRITICAL)  # Its errors are reported below.
    if not path.is_file():
        raise errors.refuse("scene", "must be a file that exists", path, "Check the path.")
    check = {
        ".ply": ply.refuse_damaged,
        ".obj": obj.refuse_damaged,
        ".glb": gltf.refuse_unsupported,
    }[path.suffix.lower()]
    try:
        check(path)
        with np.errstate(all="ignore"), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            resolver = _RegularFiles(str(path))
            parts = _parts(trimesh.load_scene(path, process=False, resolver=resolver))
    except Exception as error:  # The parsers of trimesh raise errors of any type.
        reason = str(error) or "its parts contradict each other"
        raise errors.refuse(
            "scene", "must be a mesh", path, f"It cannot be read: {reason}"
        ) from None
    if not parts:
        raise errors.refuse("scene", "must hold triangles", path, "The mesh is empty.")
    return parts


class _RegularFiles(FilePathResolver):
    """Materials and textures in the folder of a mesh. Pipes and devices are as missing files."""

    def get(self, name: str) -> bytes:
        """Read one file."""
        if not self.absolute(name).is_file():
            raise FileNotFoundError(name)
        return super().get(name)


def _parts(loaded: trimesh.Scene) -> list[tuple[str, trimesh.Trimesh]]:
    for mesh in loaded.geometry.values():
        faces = mesh.faces if isinstance(mesh, trimesh.Trimesh) else np.zeros((0, 3))
        if len(faces) and not 0 <= faces.min() <= faces.max() < len(mesh.vertices):
            raise ValueError("a triangle has a vertex that is missing")
    return [
        (str(name), mesh.copy().apply_transform(loaded.graph.get(node)[0]))
        for node in loaded.graph.nodes_geometry
        for name in [loaded.graph[node][1]]
        for mesh in [loaded.geometry[name]]
        if isinstance(mesh, trimesh.Trimesh) and len(mesh.faces)
    ]


def _front(bodies: tuple[Body, ...], sensor: Sensor) -> frames.Pose:
    """Pose in front, 20 degrees above, that sees the whole bounding sphere.

    The distance respects the sensor's nearest depth and its search range.
    """
    points = np.concatenate([body.world_mesh.vertices for body in bodies])
    low, high = points.min(axis=0), points.max(axis=0)
    middle = (low + high) / 2
    radius = float(np.linalg.norm(high - low)) / 2
    half = min(sensor.width / sensor.fx_px, sensor.height / sensor.fy_px) / 2
    nearest = max(sensor.post.near_m, sensor.focal_baseline_px_m / sensor.matcher.search_px)
    distance = max(radius * np.sqrt(1 + 1 / half**2), 1.2 * nearest + radius)
    away = np.array([0.0, np.sin(np.deg2rad(20)), np.cos(np.deg2rad(20))])
    eye = middle + max(distance, 1e-3) * away
    return frames.look_at(tuple(eye), tuple(middle), (0.0, 1.0, 0.0))
