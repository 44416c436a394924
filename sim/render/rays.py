"""Poses and pinhole cameras as Dr.Jit values."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from starling.sim.geometry import frames
from starling.sim.geometry.frames import Pose
from starling.sim.geometry.pinhole import Pinhole
from starling.sim.render import backend
from starling.sim.sensor.sensor import Sensor


@dataclass(frozen=True, slots=True)
class JitPose:
    """World pose of a part as opaque device values, so that moving it recompiles nothing."""

    x: Any
    y: Any
    z: Any
    origin: Any

    @staticmethod
    def from_pose(world_from_part: Pose) -> JitPose:
        x, y, z = (opaque("Vector3f", world_from_part[:3, i]) for i in range(3))
        return JitPose(x, y, z, opaque("Point3f", world_from_part[:3, 3]))

    def local(self, point: Any) -> Any:
        """Transform a world point to the part's frame."""
        dr = backend.drjit()
        offset = point - self.origin
        return type(offset)(dr.dot(self.x, offset), dr.dot(self.y, offset), dr.dot(self.z, offset))


@dataclass(frozen=True, slots=True)
class JitCamera:
    """A pinhole camera in the world."""

    size: tuple[int, int]  # width, height [px]
    focal: Any  # Vector2f [px]
    centre: Any  # Vector2f [px]
    place: JitPose

    def ray(self, pixel: Any) -> Any:
        """Ray through image coordinates; pixel centres are integers."""
        mi, dr = backend.mitsuba(), backend.drjit()
        slope = (pixel - self.centre) / self.focal
        direction = self.place.x * slope.x + self.place.y * slope.y + self.place.z
        return mi.Ray3f(self.place.origin, dr.normalize(direction))

    def sees(self, point: Any) -> Any:
        """Whether a world point projects into the image, without occlusion."""
        local = self.place.local(point)
        pixel = self.focal * type(self.focal)(local.x, local.y) / local.z + self.centre
        width, height = self.size
        inside = (pixel.x >= -0.5) & (pixel.x <= width - 0.5)
        return inside & (pixel.y >= -0.5) & (pixel.y <= height - 0.5) & (local.z > 0)


def opaque(kind: str, values: Any) -> Any:
    """Create a Mitsuba value that kernels read as data, not as a constant."""
    dr = backend.drjit()
    value = getattr(backend.mitsuba(), kind)(*(float(v) for v in values))
    dr.make_opaque(value)
    return value


def cameras(sensor: Sensor, world_from_left: Pose) -> tuple[JitCamera, JitCamera]:
    """The left and the right imager in the world."""
    focal = opaque("Vector2f", (sensor.fx_px, sensor.fy_px))
    centre = opaque("Vector2f", (sensor.cx_px, sensor.cy_px))
    size = (sensor.width, sensor.height)
    world_from_right = frames.right_of(world_from_left, sensor.baseline_m)
    return (
        JitCamera(size, focal, centre, JitPose.from_pose(world_from_left)),
        JitCamera(size, focal, centre, JitPose.from_pose(world_from_right)),
    )


def reduced(sensor: Sensor, place: JitPose, shrink: int) -> JitCamera:
    """An imager with a reduced resolution and the same field."""
    size = sensor.width // shrink, sensor.height // shrink
    camera = Pinhole.from_camera(sensor).resized(*size)
    return JitCamera(
        size=size,
        focal=opaque("Vector2f", (camera.fx_px, camera.fy_px)),
        centre=opaque("Vector2f", (camera.cx_px, camera.cy_px)),
        place=place,
    )


def pixels(size: tuple[int, int]) -> Any:
    """Image coordinates of all pixel centres, row by row (Vector2f)."""
    mi, dr = backend.mitsuba(), backend.drjit()
    width, height = size
    index = dr.arange(mi.UInt32, width * height)
    row = index // width
    return mi.Vector2f(mi.Float(index - row * width), mi.Float(row))
