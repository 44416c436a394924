"""Reading and writing of `scene.toml`: independently known geometry and pose of a capture.

Reference depth depends on a camera's focal length. A mesh or a builtin scene at a known pose does
not. Example of a file:

    scene = "table.ply"
    left_from_world = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0.8], [0, 0, 0, 1]]
    ambient_w_m2 = 0.4

    [[materials]]
    body = "ball*"
    reflectance = 0.3
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from starling.patterns import errors
from starling.sim import files
from starling.sim.geometry import frames
from starling.sim.geometry.frames import Pose
from starling.sim.scene.scene import BRIGHTEST_W_M2
from starling.sim.sensor import structure

FILE = "scene.toml"

_Row = tuple[float, float, float, float]
Rows = tuple[_Row, _Row, _Row, _Row]  # A 4x4 matrix, row by row.


@dataclass(frozen=True, kw_only=True, slots=True)
class KnownMaterial:
    """Known reflectance of some bodies, in the sensor's band."""

    body: str  # Names of the bodies, with wildcards `*` and `?`.
    reflectance: float  # In [0, 1], as in `starling.sim.scene.scene.Material`.

    def __post_init__(self) -> None:
        if not self.body:
            raise errors.refuse(
                "materials.body", "must name bodies", "''", "Give a name, or * for all of them."
            )
        errors.in_interval(f"reflectance of {self.body}", self.reflectance, 0.0, 1.0)


@dataclass(frozen=True, kw_only=True, slots=True)
class SceneFile:
    """Geometry of a captured scene, and the camera's pose."""

    scene: str  # A builtin name, a mesh or a Mitsuba XML; paths start at the scene's folder.
    left_from_world: Rows  # Rigid, metres; the world is the geometry's frame.
    materials: tuple[KnownMaterial, ...] = ()  # The last match of a body applies.
    ambient_w_m2: float | None = None  # Irradiance of ambient light; None: not measured.

    def __post_init__(self) -> None:
        if not self.scene.strip() or "\0" in self.scene:
            raise errors.refuse(
                "scene", "must name a scene", repr(self.scene), "Give a builtin name or a file."
            )
        frames.refuse_not_rigid("left_from_world", np.array(self.left_from_world, np.float64))
        if self.ambient_w_m2 is not None:
            errors.in_interval("ambient_w_m2", self.ambient_w_m2, 0.0, BRIGHTEST_W_M2)

    @property
    def world_from_left(self) -> Pose:
        """Pose of the left imager in the world, (4, 4)."""
        return np.asarray(np.linalg.inv(self.left_from_world), np.float64)


def read(path: Path) -> SceneFile:
    """Read `scene.toml`.

    Raises:
        InputError: if the file is missing or not TOML, or if a key is missing or unknown. Also if
            the pose is not rigid, a reflectance is outside [0, 1], or ambient light is negative.
    """
    return files.read_toml(path, _from_table)


def dumps(file: SceneFile) -> str:
    """Return TOML text that `read` reads back equal."""
    table = structure.to_table(file)
    materials = [structure.to_table(material) for material in file.materials]
    if not materials:
        del table["materials"]
    return tomli_w.dumps({**table, **({"materials": materials} if materials else {})})


def _from_table(table: Mapping[str, Any]) -> SceneFile:
    listed = table.get("materials", [])
    if not isinstance(listed, list):
        raise errors.refuse(
            "materials", "must be a list of tables", repr(listed), "Head each with [[materials]]."
        )
    materials = tuple(
        structure.from_table(KnownMaterial, item, f"materials[{number}]")
        for number, item in enumerate(listed)
    )
    rest = {key: value for key, value in table.items() if key != "materials"}
    return dataclasses.replace(structure.from_table(SceneFile, rest), materials=materials)
