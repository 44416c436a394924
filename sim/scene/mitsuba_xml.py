"""Scenes from Mitsuba XML files: shapes and the first sensor's pose, without lights."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any

import numpy as np

from starling.patterns import errors
from starling.sim.geometry import frames
from starling.sim.render import backend
from starling.sim.scene.scene import Ambient, Scene

_WHOLE = ("instance", "shapegroup")  # Shapes with child shapes, which are not supported.


def load(path: Path) -> Scene:
    """Load a Mitsuba 3 scene, y up, at the pose of its first sensor or Mitsuba's default pose.

    Projector and ambient light replace all emitters of the file. The shapes of lamps remain.

    Raises:
        InputError: if the file is missing, cannot be loaded, has no shapes, or has instances.
    """
    if not path.is_file():
        raise errors.refuse("scene", "must be a file that exists", path, "Check the path.")
    loaded = _without_lights(path)
    if not loaded.shapes():
        raise errors.refuse("scene", "must hold shapes", path, "Add a shape to the XML.")
    to_world = np.eye(4)
    if loaded.sensors():
        matrix = np.array(loaded.sensors()[0].world_transform().matrix, np.float64)
        to_world = matrix.reshape(4, 4)
        to_world[:3, :3] /= np.linalg.norm(to_world[:3, :3], axis=0)
    return Scene(
        name=path.stem,
        shapes=tuple(loaded.shapes()),
        ambient=Ambient(up=(0.0, 1.0, 0.0)),
        world_from_left=frames.opencv_from_mitsuba(to_world),
    )


def _without_lights(path: Path) -> Any:
    """Load the file without emitters, including those attached to shapes."""
    mi = backend.mitsuba()
    try:
        root = ElementTree.fromstring(path.read_bytes())
    except (ElementTree.ParseError, OSError, ValueError) as error:
        raise errors.refuse("scene", "must be a Mitsuba XML", path, f"{error}.") from None
    for shape in root.iter("shape"):
        if shape.get("type") in _WHOLE:
            raise errors.refuse(
                "scene", "must not hold instances", path, "Write each shape out, or export a mesh."
            )
    for parent in list(root.iter()):
        for light in parent.findall("emitter"):
            parent.remove(light)
    resolver = mi.file_resolver()
    resolver.prepend(str(path.parent.resolve()))  # Paths in the XML start at its folder.
    try:
        return mi.load_string(ElementTree.tostring(root, encoding="unicode"))
    except (RuntimeError, OSError, ValueError) as error:
        raise errors.refuse("scene", "must be a Mitsuba XML", path, f"{error}") from None
