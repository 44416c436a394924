"""Captures of known geometry as scenes: `scene.toml` loaded and posed, or written of a scene."""

from __future__ import annotations

import dataclasses
import os
from fnmatch import fnmatchcase
from pathlib import Path

import numpy as np

from starling.patterns import errors
from starling.sim.captures.capture import CapturedScene
from starling.sim.geometry.frames import Pose
from starling.sim.scene import mesh, scene_file, sources
from starling.sim.scene.builtin import scenes as builtin
from starling.sim.scene.scene import Body, Scene
from starling.sim.scene.scene_file import KnownMaterial, SceneFile
from starling.sim.sensor.sensor import Sensor

_FILES = (*mesh.SUFFIXES, ".xml")
_SINGLE = 1e-4  # What a pose in single precision, as Mitsuba's, may miss a rotation by.


def load(scene: CapturedScene, sensor: Sensor) -> Scene | None:
    """Load the geometry that a captured scene's `scene.toml` names, seen from the pose it gives.

    Other captures are no such geometry: their depth depends on a camera's intrinsics.

    Args:
        scene: one of a capture set.
        sensor: what sees it.

    Returns:
        The scene, its `world_from_left` the file's; None where there is no such file.

    Raises:
        InputError: if the file is refused, names no geometry that can be loaded, or gives a
            material to no body.
    """
    known = scene.known()
    if known is None:
        return None
    try:
        loaded = sources.load(_found(known.scene, scene.path), sensor)
        bodies = _with_materials(loaded.bodies, known.materials)
    except errors.InputError as error:
        raise errors.InputError(f"{scene.path / scene_file.FILE}: {error}") from error
    return dataclasses.replace(loaded, bodies=bodies, world_from_left=known.world_from_left)


def describe(word: str, world_from_left: Pose, folder: Path) -> SceneFile | None:
    """Say in a `scene.toml`'s terms which geometry is seen, and from where.

    A file stays where it is. Its path is written relative to the scene's folder where both share
    a folder below the root, so that they can be moved together; else it is absolute.

    Args:
        word: what `starling.sim.scene.sources.load` took, but no capture.
        world_from_left: pose of the left imager, (4, 4), as the geometry's owner knows it.
        folder: the captured scene's, where the file will lie.

    Returns:
        What to write, without materials: they are the geometry's own. None where the view
        mirrors or shears, as a Mitsuba XML's can, which no camera's does.
    """
    left, _, right = np.linalg.svd(world_from_left[:3, :3])
    rotation = left @ right  # The nearest orthogonal matrix.
    if np.linalg.det(rotation) < 0 or np.abs(rotation - world_from_left[:3, :3]).max() > _SINGLE:
        return None
    rows = np.eye(4)
    rows[:3, :3] = rotation.T
    rows[:3, 3] = -rotation.T @ world_from_left[:3, 3]
    a, b, c, d = (_row(row) for row in rows + 0.0)  # No -0.
    return SceneFile(
        scene=_written(word, folder) if _is_file(word) else word, left_from_world=(a, b, c, d)
    )


def carried(scene: CapturedScene, folder: Path) -> SceneFile | None:
    """Say of a captured scene what another folder's `scene.toml` must, to name the same geometry.

    Args:
        scene: one of a capture set.
        folder: where the file will lie (see `describe` for how paths are written).

    Returns:
        The scene's own file but for the path; None where it has none.

    Raises:
        InputError: as `starling.sim.scene.scene_file.read`.
    """
    known = scene.known()
    if known is None or not _is_file(known.scene):
        return known
    word = _written(os.path.join(scene.path, known.scene), folder)
    return dataclasses.replace(known, scene=word)


def _row(row: np.ndarray) -> tuple[float, float, float, float]:
    x, y, z, shift = map(float, row)
    return x, y, z, shift


def _is_builtin(word: str) -> bool:
    return word.partition(":")[0] in builtin.BUILTIN


def _is_file(word: str) -> bool:
    return not _is_builtin(word) and Path(word).suffix.lower() in _FILES


def _found(word: str, folder: Path) -> str:
    """Return the word for `starling.sim.scene.sources.load`: a path from the folder, or a builtin name."""
    if _is_builtin(word):
        return word
    if not _is_file(word):
        raise errors.refuse(
            "scene",
            "must be a builtin name, a mesh or a Mitsuba XML",
            repr(word),
            f"Builtin: {', '.join(builtin.BUILTIN)}; files: {', '.join(_FILES)}.",
        )
    path = os.path.join(folder, word)
    if not os.path.isfile(path):
        raise errors.refuse(
            "scene", "must be a file that exists", path, "Its path starts at the scene's folder."
        )
    return path


def _written(word: str, folder: Path) -> str:
    """Return the path to a file for a `scene.toml` in the folder, with forward slashes."""
    # Links on the way are followed, for `..` would not go back over them; its own name stays.
    file = Path(os.path.realpath(os.path.dirname(word)), os.path.basename(word))
    place = Path(os.path.realpath(folder))
    if file.parts[:2] != place.parts[:2]:
        return file.as_posix()
    return Path(os.path.relpath(file, place)).as_posix()


def _with_materials(
    bodies: tuple[Body, ...], materials: tuple[KnownMaterial, ...]
) -> tuple[Body, ...]:
    for material in materials:
        if not any(fnmatchcase(body.name, material.body) for body in bodies):
            there = ", ".join(body.name for body in bodies) or "none, shapes of an XML keep theirs"
            raise errors.refuse(
                "materials.body", "must name a body", repr(material.body), f"There are: {there}."
            )
        bodies = tuple(
            _reflecting(body, material.reflectance)
            if fnmatchcase(body.name, material.body)
            else body
            for body in bodies
        )
    return bodies


def _reflecting(body: Body, reflectance: float) -> Body:
    return dataclasses.replace(
        body, material=dataclasses.replace(body.material, reflectance=reflectance), texture=None
    )
