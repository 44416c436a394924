"""Captured scenes of known geometry: reading and writing of `scene.toml`."""

from __future__ import annotations

import dataclasses
import os
from fnmatch import fnmatchcase
from pathlib import Path

import numpy as np

from starling.patterns import errors
from starling.sim.captures.capture import CapturedScene
from starling.sim.geometry.frames import Pose
from starling.sim.scene import scene_file, sources
from starling.sim.scene.builtin import scenes
from starling.sim.scene.placing import AS_IN_FILE, Placing, Viewpoint
from starling.sim.scene.scene import Body, Scene
from starling.sim.scene.scene_file import KnownMaterial, SceneFile
from starling.sim.sensor.sensor import Sensor

_FILES = (*sources.MESH_SUFFIXES, ".xml", ".mjcf", ".urdf")
_SINGLE = 1e-4  # Tolerance of rotations in single precision, as in Mitsuba.


def load(scene: CapturedScene, sensor: Sensor) -> Scene | None:
    """Load the geometry, pose and ambient light that a captured scene's `scene.toml` names.

    The geometry must not be a capture, since its depth depends on a camera's intrinsics.

    Args:
        scene: Scene of a capture set.
        sensor: Sensor that observes it.

    Returns:
        Scene with the file's `world_from_left` and ambient light; None if there is no file.

    Raises:
        InputError: if the file is refused, if its geometry cannot be loaded, or if a material
            matches no body.
    """
    known = scene.known()
    if known is None:
        return None
    with errors.naming(scene.path / scene_file.FILE):
        return _described(known, scene.path, sensor, AS_IN_FILE)


def load_file(path: Path, sensor: Sensor, frame: Placing, *, posed: bool = False) -> Scene:
    """Load a scene that a TOML describes.

    Without a pose in the file, the scene has its default pose.

    Args:
        path: TOML as `scene.toml`.
        sensor: Sensor that observes it.
        frame: Unit, up axis and state that precede the file's.
        posed: Whether the scene will be seen from elsewhere, so that it needs no camera.

    Raises:
        InputError: as `load`.
    """
    known = scene_file.read_unposed(path)
    with errors.naming(path):
        return _described(known, path.parent, sensor, frame, posed=posed)


def _described(
    known: SceneFile, folder: Path, sensor: Sensor, frame: Placing, *, posed: bool = False
) -> Scene:
    """Load geometry with the file's pose, materials and ambient light."""
    pose = None if known.left_from_world is None else known.world_from_left
    if posed and pose is None and known.look_at is None:
        pose = np.eye(4)  # Replaced by the caller.
    geometry = _resolve_path(known.scene, folder)
    view = Viewpoint(pose=pose, look_at=known.look_at)
    loaded = sources.load(geometry, sensor, frame.over(_frame(known, folder)), view)
    ambient = loaded.ambient
    if known.ambient_w_m2 is not None:
        ambient = dataclasses.replace(ambient, irradiance_w_m2=known.ambient_w_m2)
    bodies = _with_materials(loaded.bodies, known.materials)
    return dataclasses.replace(loaded, bodies=bodies, ambient=ambient)


def states_ambient(known: SceneFile) -> bool:
    """Return whether a `scene.toml` says how bright ambient light is.

    A builtin scene has its own light. A mesh has none, and lamps of an XML are not loaded.
    """
    return known.ambient_w_m2 is not None or _is_builtin(known.scene)


def describe(
    specifier: str, file_from_left: Pose, folder: Path, frame: Placing = AS_IN_FILE
) -> SceneFile | None:
    """Describe geometry and pose for a `scene.toml`.

    Geometry files are not copied. A path is relative to the scene's folder if both share a folder
    below the root, so that they can be moved together. Otherwise it is absolute.

    Args:
        specifier: Argument of `starling.sim.scene.sources.load`, except captures.
        file_from_left: Pose of the left imager (4, 4) in the geometry's frame.
        folder: Folder of the captured scene, where the file will be.
        frame: Unit, up axis and state that precede those of a file.

    Returns:
        Content of the file, with materials if the specifier is a TOML. None if the pose mirrors or
        shears, which is possible in a Mitsuba XML.
    """
    left, _, right = np.linalg.svd(file_from_left[:3, :3])
    rotation = left @ right  # The nearest orthogonal matrix.
    if np.linalg.det(rotation) < 0 or np.abs(rotation - file_from_left[:3, :3]).max() > _SINGLE:
        return None
    rows = np.eye(4)
    rows[:3, :3] = rotation.T
    rows[:3, 3] = -rotation.T @ file_from_left[:3, 3]
    a, b, c, d = (_row(row) for row in rows + 0.0)  # No -0.
    known, source = SceneFile(scene=specifier), Path()
    if not _is_builtin(specifier) and Path(specifier).suffix.lower() == ".toml":
        known, source = scene_file.read_unposed(Path(specifier)), Path(specifier).parent
        specifier = _resolve_path(known.scene, source)
    placing = frame.over(_frame(known, source))
    return dataclasses.replace(
        known,
        scene=_relative_path(specifier, folder) if _is_file(specifier) else specifier,
        left_from_world=(a, b, c, d),
        look_at=None,
        up=placing.up,
        unit=placing.unit,
        camera=None,
        keyframe=placing.keyframe,
        qpos=None if placing.qpos is None else _relative_path(placing.qpos, folder),
    )


def _frame(known: SceneFile, folder: Path) -> Placing:
    """What a file in a folder says of its geometry, with paths from here."""
    if known.qpos is None:
        return known.frame
    return dataclasses.replace(known.frame, qpos=os.path.join(folder, known.qpos))


def for_folder(scene: CapturedScene, folder: Path) -> SceneFile | None:
    """Describe a captured scene's geometry for the `scene.toml` of another folder.

    Args:
        scene: Scene of a capture set.
        folder: Folder where the file will be (see `describe` for paths).

    Returns:
        The scene's file with the path adapted; None if it has no file.

    Raises:
        InputError: as `starling.sim.scene.scene_file.read`.
    """
    known = scene.known()
    if known is None or not _is_file(known.scene):
        return known
    path = _relative_path(os.path.join(scene.path, known.scene), folder)
    qpos = _frame(known, scene.path).qpos
    qpos = None if qpos is None else _relative_path(qpos, folder)
    return dataclasses.replace(known, scene=path, qpos=qpos)


def _row(row: np.ndarray) -> tuple[float, float, float, float]:
    x, y, z, shift = map(float, row)
    return x, y, z, shift


def _is_builtin(specifier: str) -> bool:
    return specifier.partition(":")[0] in scenes.BUILTIN


def _is_file(specifier: str) -> bool:
    return not _is_builtin(specifier) and Path(specifier).suffix.lower() in _FILES


def _resolve_path(specifier: str, folder: Path) -> str:
    """Return a builtin name, or the path of a file relative to the folder."""
    if _is_builtin(specifier):
        return specifier
    if not _is_file(specifier):
        raise errors.refuse(
            "scene",
            "must be a builtin name, a mesh or a Mitsuba XML",
            repr(specifier),
            f"Builtin: {', '.join(scenes.BUILTIN)}; files: {', '.join(_FILES)}.",
        )
    path = os.path.join(folder, specifier)
    if not os.path.isfile(path):
        raise errors.refuse(
            "scene", "must be a file that exists", path, "Its path starts at the scene's folder."
        )
    return path


def _relative_path(specifier: str, folder: Path) -> str:
    """Return a file's path for a `scene.toml` in the folder, with forward slashes."""
    # Links in the path are resolved, because `..` would leave them; the file's name is kept.
    file = Path(os.path.realpath(os.path.dirname(specifier)), os.path.basename(specifier))
    base = Path(os.path.realpath(folder))
    if file.parts[:2] != base.parts[:2]:
        return file.as_posix()
    return Path(os.path.relpath(file, base)).as_posix()


def _with_materials(
    bodies: tuple[Body, ...], materials: tuple[KnownMaterial, ...]
) -> tuple[Body, ...]:
    for material in materials:
        if not any(fnmatchcase(body.name, material.body) for body in bodies):
            names = ", ".join(body.name for body in bodies) or "none, shapes of an XML keep theirs"
            raise errors.refuse(
                "materials.body", "must name a body", repr(material.body), f"There are: {names}."
            )
        if not any(_is_meant(body, material) for body in bodies):
            names = ", ".join(sorted({body.material.name for body in bodies}))
            rule, got = "must name a material of the bodies", repr(material.material)
            raise errors.refuse("materials.material", rule, got, f"There are: {names}.")
        bodies = tuple(
            _changed(body, material) if _is_meant(body, material) else body for body in bodies
        )
    return bodies


def _is_meant(body: Body, material: KnownMaterial) -> bool:
    of_body = fnmatchcase(body.name, material.body)
    return of_body and fnmatchcase(body.material.name, material.material)


def _changed(body: Body, known: KnownMaterial) -> Body:
    """Return a body with known properties, which replace its images.

    A reflectance is in the sensor's band: without a visible colour, it holds in any.
    """
    plain = known.reflectance is not None or known.rgb is not None
    changes = known.changes if known.reflectance is None else {"rgb": None, **known.changes}
    return dataclasses.replace(
        body,
        material=dataclasses.replace(body.material, **changes),
        texture=body.texture if known.reflectance is None else None,
        colour=None if plain else body.colour,
    )
