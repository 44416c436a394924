"""Reading and writing of `scene.toml`: geometry, pose and materials of a scene.

In a capture set it states geometry and pose that are known independently. Reference depth depends
on a camera's focal length; a mesh or a builtin scene at a known pose does not. Simulated directly,
it describes a scene. Example of a file:

    scene = "table.glb"
    unit = "mm"
    up = "z"
    left_from_world = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0.8], [0, 0, 0, 1]]
    ambient_w_m2 = 0.4

    [[materials]]
    body = "ball*"
    reflectance = 0.3

    [[materials]]
    body = "*"
    material = "Chrome"
    kind = "metal"
    roughness = 0.05
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
from starling.sim.scene.placing import LookAt, Placing
from starling.sim.scene.scene import BRIGHTEST_W_M2, Material
from starling.sim.sensor import structure

FILE = "scene.toml"

_Row = tuple[float, float, float, float]
Rows = tuple[_Row, _Row, _Row, _Row]  # A 4x4 matrix, row by row.


@dataclass(frozen=True, kw_only=True, slots=True)
class KnownMaterial:
    """Known properties of the surface of some bodies; None keeps the geometry's own."""

    body: str  # Names of the bodies, with wildcards `*` and `?`.
    material: str = "*"  # Names of their materials in the geometry's file, with wildcards.
    reflectance: float | None = None  # In the sensor's band, in [0, 1]; it replaces images.
    kind: str | None = None  # As in `starling.sim.scene.scene.Material`.
    roughness: float | None = None  # Microfacet slope (GGX alpha) of glossy and metal.
    rgb: tuple[float, float, float] | None = None  # Visible, linear; it replaces a colour image.

    def __post_init__(self) -> None:
        if not self.body:
            raise errors.refuse(
                "materials.body", "must name bodies", "''", "Give a name, or * for all of them."
            )
        if not self.changes:
            known = "reflectance, kind, roughness or rgb"
            raise errors.refuse(
                f"materials of {self.body}", f"must give {known}", "nothing", "Add one."
            )
        Material(name=self.body, **self.changes)  # It checks the values.

    @property
    def changes(self) -> dict[str, Any]:
        """Fields of `Material` that are given."""
        names = ("reflectance", "kind", "roughness", "rgb")
        values = {name: getattr(self, name) for name in names}
        return {name: value for name, value in values.items() if value is not None}


@dataclass(frozen=True, kw_only=True, slots=True)
class SceneFile:
    """Geometry of a scene, and the camera's pose."""

    scene: str  # A builtin name, a mesh or a Mitsuba XML; paths start at the file's folder.
    left_from_world: Rows | None = None  # Rigid, metres; the world is the geometry's frame.
    look_at: LookAt | None = None  # Eye and target in the world [m], in place of the pose.
    up: str | None = None  # Axis of the mesh that points up; None: as the mesh says.
    unit: str | None = None  # Unit of the mesh: m, cm, mm or in; None: as the mesh says.
    camera: str | None = None  # Camera of a model, in place of a pose.
    keyframe: str | None = None  # Keyframe of a model.
    qpos: str | None = None  # File of a model's generalized positions, as `scene`.
    materials: tuple[KnownMaterial, ...] = ()  # Later matches of a body precede earlier ones.
    ambient_w_m2: float | None = None  # Irradiance of ambient light; None: not measured.

    def __post_init__(self) -> None:
        if not self.scene.strip() or "\0" in self.scene:
            raise errors.refuse(
                "scene", "must name a scene", repr(self.scene), "Give a builtin name or a file."
            )
        if self.left_from_world is not None:
            frames.refuse_not_rigid("left_from_world", np.array(self.left_from_world, np.float64))
            if self.look_at is not None:
                rule = "must not be given with left_from_world"
                raise errors.refuse("look_at", rule, list(self.look_at), "Leave one out.")
        if self.ambient_w_m2 is not None:
            errors.in_interval("ambient_w_m2", self.ambient_w_m2, 0.0, BRIGHTEST_W_M2)
        _ = self.frame  # It checks the values.

    @property
    def frame(self) -> Placing:
        """Unit and up axis of the mesh, where its own do not hold; state of a model."""
        names = (field.name for field in dataclasses.fields(Placing))
        return Placing(**{name: getattr(self, name) for name in names})

    @property
    def world_from_left(self) -> Pose:
        """Pose of the left imager in the world, (4, 4).

        Raises:
            InputError: if the file has none, as of a scene that is not captured.
        """
        if self.left_from_world is None:
            raise errors.refuse("left_from_world", "must be given", "nothing", "Add the key.")
        return np.asarray(np.linalg.inv(self.left_from_world), np.float64)


def read(path: Path) -> SceneFile:
    """Read the `scene.toml` of a capture, which states the pose.

    Raises:
        InputError: if the file is missing or not TOML, or if a key is missing or unknown. Also if
            the pose is not rigid, a reflectance is outside [0, 1], or ambient light is negative.
    """
    return files.read_toml(path, _posed)


def read_unposed(path: Path) -> SceneFile:
    """Read the TOML of a scene that is simulated, which may leave out the pose.

    Raises:
        InputError: as `read`, except of the pose.
    """
    return files.read_toml(path, _from_table)


def dumps(file: SceneFile) -> str:
    """Return TOML text that `read` reads back equal."""
    table = structure.to_table(file)
    materials = [structure.to_table(material) for material in file.materials]
    if not materials:
        del table["materials"]
    return tomli_w.dumps({**table, **({"materials": materials} if materials else {})})


def _posed(table: Mapping[str, Any]) -> SceneFile:
    file = _from_table(table)
    if file.left_from_world is None:
        raise errors.refuse("left_from_world", "must be given", "nothing", "Add the key.")
    return file


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
