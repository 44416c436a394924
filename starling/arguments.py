"""Checks of the types of arguments of the public interface."""

from __future__ import annotations

import os
import warnings
from pathlib import Path
from typing import TYPE_CHECKING

from starling.patterns.errors import instance

if TYPE_CHECKING:
    from starling.sim.captures.capture import CaptureSet
    from starling.sim.scene.scene import Scene
    from starling.sim.sensor.sensor import Sensor


def text(name: str, value: object, remedy: str) -> str:
    """Return text, or the text of a path.

    Raises:
        InputError: if the value is neither.
    """
    return os.fspath(instance(name, value, (str, Path), remedy))


def path(name: str, value: object) -> Path:
    """Return a path that is given as text or as a path.

    Raises:
        InputError: if the value is neither.
    """
    return Path(text(name, value, "Give a path."))


def scene(value: object, camera: Sensor) -> Scene:
    """Return a scene, or load it by its specifier.

    Raises:
        InputError: if there is no such scene.
    """
    from starling.sim.scene import sources
    from starling.sim.scene.scene import Scene

    if isinstance(value, Scene):
        return value
    return sources.load(text("scene", value, "Give its name, its file or a Scene."), camera)


def warn_of_size(shape: tuple[int, ...], camera: Sensor) -> None:
    """Warn of an image of another size than the sensor's: its focal length may be another."""
    size = (camera.height, camera.width)
    if shape != size:
        warnings.warn(
            f"ir_left is of size {shape}, and {camera.name} of {size}: depth is right for a crop "
            f"only. Load the sensor with the images' camera_matrix.",
            stacklevel=3,
        )


def captures(name: str, value: object) -> CaptureSet:
    """Return captures, or open their folder.

    Raises:
        InputError: if the folder is no capture set.
    """
    from starling.sim.captures import capture

    if isinstance(value, capture.CaptureSet):
        return value
    return capture.open_set(path(name, value))
