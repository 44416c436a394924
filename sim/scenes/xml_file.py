"""A Mitsuba XML as a scene: its shapes and its first sensor's pose; its lights are not taken."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from patterns import errors
from sim import backend, frames
from sim.scene import Scene


def load(path: Path) -> Scene:
    """Load a Mitsuba 3 scene; without a sensor in it the left imager stands at the origin.

    The projector and the ambient light replace the emitters of the file.

    Raises:
        InputError: if the file is missing, cannot be loaded, or holds no shapes.
    """
    if not path.is_file():
        raise errors.refuse("scene", "must be a file that exists", path, "Check the path.")
    mi = backend.mitsuba()
    try:
        loaded = mi.load_file(str(path))
    except (RuntimeError, OSError, ValueError) as error:
        raise errors.refuse("scene", "must be a Mitsuba XML", path, f"{error}") from None
    if not loaded.shapes():
        raise errors.refuse("scene", "must hold shapes", path, "Add a shape to the XML.")
    pose = np.eye(4)
    if loaded.sensors():
        pose = _pose(loaded.sensors()[0])
    return Scene(name=path.stem, xml=path, world_from_left=pose)


def _pose(sensor: object) -> frames.Pose:
    """OpenCV pose of a Mitsuba sensor, its scale taken out."""
    matrix = np.array(sensor.world_transform().matrix, np.float64)  # type: ignore[attr-defined]
    to_world = matrix.reshape(4, 4) if matrix.size == 16 else matrix[..., 0]
    to_world[:3, :3] /= np.linalg.norm(to_world[:3, :3], axis=0)
    return frames.opencv_from_mitsuba(to_world)
