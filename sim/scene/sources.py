"""Loading of scenes by specifier: builtin name, mesh, Mitsuba XML, TOML or real capture."""

from __future__ import annotations

import os
import warnings
from pathlib import Path

import numpy as np
import trimesh

from starling.patterns import errors
from starling.sim.captures import capture
from starling.sim.geometry import frames
from starling.sim.scene import mitsuba_xml
from starling.sim.scene.meshes import appearance, mesh_file
from starling.sim.scene.meshes.appearance import MeshFile
from starling.sim.scene.placing import (
    AS_IN_FILE,
    AS_IN_SCENE,
    OF_MESH,
    OF_MODEL,
    Placing,
    Viewpoint,
)
from starling.sim.scene.scene import Ambient, Body, Scene, Sun
from starling.sim.sensor.sensor import Sensor

MESH_SUFFIXES = mesh_file.SUFFIXES

_CONVERTIBLE = (".gltf", ".fbx", ".off", ".blend", ".ifc", ".wrl", ".3ds")
_LARGEST_M = 100.0  # Largest extent of a mesh; larger ones are not in metres [m].
_USUAL_M = (0.005, 30.0)  # Extents of objects and rooms; others give a warning [m].
_NEAR_M = 1000.0  # Largest coordinate of a mesh that is not shifted to the origin [m].

Direction = tuple[float, float, float]
# Directions by the axis that points up. The front of a scene with z up is -y, as in Blender.
UP: dict[str, Direction] = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
_FRONT: dict[str, Direction] = {
    "x": (0.0, 0.0, 1.0),
    "y": (0.0, 0.0, 1.0),
    "z": (0.0, -1.0, 0.0),
}
_SUN: dict[str, Direction] = {
    "x": (0.9, -0.3, 0.3),
    "y": mitsuba_xml.SUN_Y_UP,
    "z": (0.3, -0.3, 0.9),
}


def load(
    specifier: str,
    sensor: Sensor,
    frame: Placing = AS_IN_FILE,
    view: Viewpoint = AS_IN_SCENE,
) -> Scene:
    """Load the scene of a specifier.

    Args:
        specifier: One of the following. A builtin name: `wall`, `staircase`, `tabletop`, `clutter`
            or `room`, also as NAME:NUMBER with a distance in metres or a seed. A mesh file: one of
            `MESH_SUFFIXES`. A Mitsuba `.xml`. A model of MuJoCo, or a URDF. A `scene.toml`. The
            folder of a scene in a capture set, whose own `scene.toml` precedes its reference depth.
        sensor: Sensor whose field of view a mesh's default pose fits.
        frame: Unit and up axis of a mesh file, where its own do not hold; camera and state of a
            model.
        view: Where the camera stands, where the scene's own pose does not hold.

    Raises:
        InputError: if the specifier is unknown, or the scene is refused.
    """
    return view.seen(_load(specifier, sensor, frame, view.is_given))


def _load(specifier: str, sensor: Sensor, frame: Placing, posed: bool) -> Scene:
    from starling.sim.mujoco import model_file
    from starling.sim.scene.builtin import scenes
    from starling.sim.scene.captured import captured_scene, known_geometry

    name, _, number = specifier.partition(":")
    path = Path(specifier)
    suffix = path.suffix.lower()
    built = name in scenes.BUILTIN
    if not built and suffix == ".toml":
        return known_geometry.load_file(path, sensor, frame, posed=posed)
    if not built and model_file.is_model(path):
        return _load_model(path, frame, posed)
    frame.refuse(OF_MODEL, "a model of MuJoCo or a URDF", specifier)
    if not built and suffix in MESH_SUFFIXES:
        return load_mesh(path, sensor, frame=frame)
    frame.refuse(OF_MESH, f"a mesh file: {', '.join(MESH_SUFFIXES)}", specifier)
    if built:
        return scenes.named(name, number)
    if suffix == ".xml":
        return mitsuba_xml.load(path)
    if os.path.isdir(path):  # Unlike `is_dir`, it bears names that are too long.
        captured = capture.open_set(path).scenes
        known = known_geometry.load(captured[0], sensor) if len(captured) == 1 else None
        return captured_scene.load(path, sensor) if known is None else known
    if suffix in _CONVERTIBLE:
        advice = "Convert it to GLB, for example with Blender or trimesh."
        rule = f"must be one of {', '.join(MESH_SUFFIXES)}, .xml, .mjcf, .urdf or .toml"
        raise errors.refuse("scene", rule, path, advice)
    known = f"Builtin: {', '.join(scenes.BUILTIN)}; meshes: {', '.join(MESH_SUFFIXES)}."
    if not os.path.exists(path) and "/" not in specifier:
        errors.one_of("scene", name, scenes.BUILTIN)
    raise errors.refuse(
        "scene",
        "must be a builtin name, a mesh, a Mitsuba XML, a TOML or a capture",
        repr(specifier),
        known,
    )


def _load_model(path: Path, frame: Placing, posed: bool) -> Scene:
    """Load a model of MuJoCo or a URDF, seen by one of its cameras unless `posed` elsewhere."""
    from starling.sim.mujoco import model_file

    frame.refuse(OF_MESH, f"a mesh file: {', '.join(MESH_SUFFIXES)}", str(path))
    if frame.camera is None and not posed:
        cameras = ", ".join(model_file.cameras(path)) or "none, so give --pose or --look-at"
        raise errors.refuse("camera", "must be given", "nothing", f"Cameras of {path}: {cameras}.")
    qpos = None if frame.qpos is None else Path(frame.qpos)
    return model_file.load(path, camera=frame.camera, keyframe=frame.keyframe or "", qpos=qpos)


def load_mesh(
    path: Path,
    sensor: Sensor,
    world_from_left: frames.Pose | None = None,
    frame: Placing = AS_IN_FILE,
) -> Scene:
    """Load a mesh file with the looks of its surfaces; without any colour reflectance is 0.5.

    Args:
        path: Mesh file.
        sensor: Sensor whose field of view the default pose fits.
        world_from_left: Pose of the left imager in the file's frame [m]. The default looks from
            the front and above, and sees the whole mesh.
        frame: Unit and up axis, where the file's own do not hold.

    Raises:
        InputError: if the file is missing, corrupt or empty.
    """
    file = mesh_file.read(path)
    scale = frame.scale(file.unit_m)
    _check_size(file, path, scale)
    origin = _origin(file, scale)
    bodies = appearance.bodies(file.parts, scale, origin)
    axis = frame.up or file.up
    up, front, sun = UP[axis], _FRONT[axis], _SUN[axis]
    pose = _overview(bodies, sensor, up, front)
    if world_from_left is not None:
        pose = world_from_left.copy()
        pose[:3, 3] -= origin
    x, y, z = origin.tolist()
    return Scene(
        name=path.stem,
        bodies=bodies,
        ambient=Ambient(up=up),
        sun=Sun(towards=sun),
        world_from_left=pose,
        origin_m=(x, y, z),
    )


def refuse_mesh(path: Path) -> None:
    """Refuse a mesh file that cannot be loaded or is not in metres; warn of an unusual size.

    Raises:
        InputError: as `load_mesh`.
    """
    file = mesh_file.read(path)
    _check_size(file, path, file.unit_m)


def _bounds(file: MeshFile, scale: float) -> tuple[np.ndarray, np.ndarray]:
    points = np.concatenate([part.vertices for part in file.parts]) * scale
    return points.min(axis=0), points.max(axis=0)


def _check_size(file: MeshFile, path: Path, scale: float) -> None:
    """Refuse a mesh that cannot be in metres, and warn of an unusual size."""
    low, high = _bounds(file, scale)
    extent = float((high - low).max())
    if not np.isfinite([low, high]).all():
        rule, advice = "must have finite vertices", "Export it again."
        raise errors.refuse("mesh", rule, f"NaN or infinite ones in {path}", advice)
    if extent > _LARGEST_M:
        rule = f"must be at most {_LARGEST_M:g} m wide"
        advice = "It looks like millimetres: give --unit mm, or scale the mesh by 0.001."
        raise errors.refuse("mesh", rule, f"{extent:g} m in {path}", advice)
    farthest_m = float(np.abs([low, high]).max())
    if farthest_m > frames.FARTHEST_M:
        rule = f"must lie within {frames.FARTHEST_M:g} m of its origin"
        got = f"a coordinate of {farthest_m:g} m in {path}"
        raise errors.refuse("mesh", rule, got, "Subtract an offset from all vertices.")
    if not _USUAL_M[0] <= extent <= _USUAL_M[1]:
        unit = "metres" if scale == 1 else f"units of {scale:g} m"
        warnings.warn(
            f"{path} is {extent:.3g} m wide: meshes are read in {unit}. "
            f"Give --unit, or scale it, if that is wrong.",
            stacklevel=3,
        )


def _origin(file: MeshFile, scale: float) -> np.ndarray:
    """Return the point (3,) that becomes the world's origin; 0 for meshes near it."""
    low, high = _bounds(file, scale)
    if np.abs([low, high]).max() <= _NEAR_M:
        return np.zeros(3)
    return np.round((low + high) / 2)


def mesh_parts(path: Path) -> list[tuple[str, trimesh.Trimesh]]:
    """Name and triangles of each part of a mesh file, in the file's frame [m].

    Raises:
        InputError: if the file is missing, corrupt or empty.
    """
    file = mesh_file.read(path)
    return [
        (part.name, trimesh.Trimesh(part.vertices * file.unit_m, part.faces, process=False))
        for part in file.parts
    ]


def _overview(
    bodies: tuple[Body, ...], sensor: Sensor, up: Direction, front: Direction
) -> frames.Pose:
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
    angle = np.deg2rad(20)
    away = np.sin(angle) * np.array(up) + np.cos(angle) * np.array(front)
    eye = middle + max(distance, 1e-3) * away
    return frames.look_at(tuple(eye), tuple(middle), up)
