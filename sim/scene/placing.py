"""What the file of a scene leaves open: unit, up axis, state of a robot, and viewpoint."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np

from starling.patterns import errors
from starling.sim.geometry import frames
from starling.sim.geometry.frames import Pose
from starling.sim.scene.scene import Scene

UNITS_M = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254}
AXES = ("x", "y", "z")
LookAt = tuple[float, float, float, float, float, float]  # Eye and target [m].

_PARALLEL = 1e-6  # Sine of the smallest angle between a view and the up direction.


@dataclass(frozen=True, kw_only=True, slots=True)
class Placing:
    """Unit and up axis of a mesh file, or state of a model file; None keeps the file's own."""

    up: str | None = None  # Axis of a mesh that points up.
    unit: str | None = None  # Unit of its coordinates.
    camera: str | None = None  # Camera of a model that becomes the left imager.
    keyframe: str | None = None  # Keyframe of a model.
    qpos: str | None = None  # File of a model's generalized positions.

    def __post_init__(self) -> None:
        if self.up is not None:
            errors.one_of("up", self.up, AXES)
        if self.unit is not None:
            errors.one_of("unit", self.unit, UNITS_M)

    def scale(self, unit_m: float) -> float:
        """Metres in the unit of a file that says `unit_m`."""
        return unit_m if self.unit is None else UNITS_M[self.unit]

    def over(self, fallback: Placing) -> Placing:
        """This placing, with entries of a fallback where this has none."""
        return Placing(**{**fallback.given(), **self.given()})

    def given(self) -> dict[str, str]:
        """Entries that are not None."""
        return {name: value for name, value in dataclasses.asdict(self).items() if value}

    def refuse(self, names: tuple[str, ...], kind: str, specifier: str) -> None:
        """Refuse entries that a scene of another kind has no use for.

        Args:
            names: entries that must not be given.
            kind: kind of scene that they are for.
            specifier: the scene.
        """
        wrong = [name for name in self.given() if name in names]
        if wrong:
            rule = f"must be given with {kind}"
            raise errors.refuse(", ".join(wrong), rule, repr(specifier), "Leave them out.")


AS_IN_FILE = Placing()
OF_MESH = ("up", "unit")
OF_MODEL = ("camera", "keyframe", "qpos")


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Viewpoint:
    """Where the camera stands in the frame of a scene's file; at most one of both is given."""

    pose: Pose | None = None  # Pose of the left imager (4, 4) in OpenCV's axes [m].
    look_at: LookAt | None = None
    timestamp: float | None = None  # [s]

    def __post_init__(self) -> None:
        if self.pose is not None and self.look_at is not None:
            raise errors.refuse("pose, look-at", "must not both be given", "both", "Leave one out.")

    @property
    def is_given(self) -> bool:
        """Whether the camera stands elsewhere than in the scene's own pose."""
        return self.pose is not None or self.look_at is not None

    def seen(self, scene: Scene) -> Scene:
        """Return a scene seen from here; as it is without a pose."""
        pose = self.pose if self.look_at is None else looking_at(scene, self.look_at)
        return scene if pose is None else seen_from(scene, pose)


AS_IN_SCENE = Viewpoint()


def seen_from(scene: Scene, file_from_left: Pose) -> Scene:
    """Return a scene that is seen from a pose in the frame of its file.

    Args:
        scene: scene.
        file_from_left: pose of the left imager (4, 4) in OpenCV's axes [m].
    """
    pose = np.array(file_from_left, np.float64)
    pose[:3, 3] -= scene.origin_m
    return dataclasses.replace(scene, world_from_left=pose)


def looking_at(scene: Scene, look_at: LookAt) -> Pose:
    """Pose (4, 4) of a camera that looks at a point, upright in a scene.

    Up in the picture is up in the scene. In a vertical view it is the direction away from the
    front: +y where z is up, -z where y is up.

    Args:
        scene: scene; its ambient light says what is up.
        look_at: eye and target in the frame of the scene's file [m].

    Raises:
        InputError: if eye and target coincide, or a number is not finite.
    """
    for name, number in zip(("eye x", "y", "z", "target x", "y", "z"), look_at, strict=True):
        errors.in_interval(f"look-at {name}", number, -frames.FARTHEST_M, frames.FARTHEST_M)
    eye, target = look_at[:3], look_at[3:]
    up = scene.ambient.up
    view = np.subtract(target, eye)
    if np.linalg.norm(np.cross(view, up)) <= _PARALLEL * np.linalg.norm(view):
        up = (0.0, 1.0, 0.0) if abs(up[2]) > abs(up[1]) else (0.0, 0.0, -1.0 if up[1] >= 0 else 1.0)
    return frames.look_at((eye[0], eye[1], eye[2]), (target[0], target[1], target[2]), up)
