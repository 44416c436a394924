"""Pinhole cameras as Dr.Jit values: rays through pixels, and what falls inside an image."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from starling.sim.geometry import frames
from starling.sim.geometry.frames import Pose
from starling.sim.render import backend
from starling.sim.sensor.sensor import Sensor


@dataclass(frozen=True, slots=True)
class Placed:
    """A part's place in the world as opaque device values: moving it recompiles nothing."""

    x: Any
    y: Any
    z: Any
    origin: Any

    @staticmethod
    def of(world_from_part: Pose) -> Placed:
        x, y, z = (opaque("Vector3f", world_from_part[:3, i]) for i in range(3))
        return Placed(x, y, z, opaque("Point3f", world_from_part[:3, 3]))

    def local(self, point: Any) -> Any:
        """World point to the part's frame."""
        dr = backend.drjit()
        offset = point - self.origin
        return type(offset)(dr.dot(self.x, offset), dr.dot(self.y, offset), dr.dot(self.z, offset))


@dataclass(frozen=True, slots=True)
class Camera:
    """A pinhole camera in the world."""

    size: tuple[int, int]  # width, height [px]
    focal: Any  # Vector2f [px]
    centre: Any  # Vector2f [px]
    place: Placed

    def ray(self, pixel: Any) -> Any:
        """Ray through image coordinates (pixel centres are integers)."""
        mi, dr = backend.mitsuba(), backend.drjit()
        slope = (pixel - self.centre) / self.focal
        direction = self.place.x * slope.x + self.place.y * slope.y + self.place.z
        return mi.Ray3f(self.place.origin, dr.normalize(direction))

    def sees(self, point: Any) -> Any:
        """Whether a world point falls inside the image (occlusion aside)."""
        local = self.place.local(point)
        pixel = self.focal * type(self.focal)(local.x, local.y) / local.z + self.centre
        width, height = self.size
        inside = (pixel.x >= -0.5) & (pixel.x <= width - 0.5)
        return inside & (pixel.y >= -0.5) & (pixel.y <= height - 0.5) & (local.z > 0)


def opaque(kind: str, values: Any) -> Any:
    """Make a Mitsuba value that kernels read as data, not as a constant."""
    dr = backend.drjit()
    value = getattr(backend.mitsuba(), kind)(*(float(v) for v in values))
    dr.make_opaque(value)
    return value


def cameras(sensor: Sensor, world_from_left: Pose) -> tuple[Camera, Camera]:
    """The left and the right imager in the world."""
    focal = opaque("Vector2f", (sensor.fx_px, sensor.fy_px))
    centre = opaque("Vector2f", (sensor.cx_px, sensor.cy_px))
    size = (sensor.width, sensor.height)
    world_from_right = frames.right_of(world_from_left, sensor.baseline_m)
    return (
        Camera(size, focal, centre, Placed.of(world_from_left)),
        Camera(size, focal, centre, Placed.of(world_from_right)),
    )


def pixels(size: tuple[int, int]) -> Any:
    """Image coordinates of all pixel centres, row by row (Vector2f)."""
    mi, dr = backend.mitsuba(), backend.drjit()
    width, height = size
    index = dr.arange(mi.UInt32, width * height)
    row = index // width
    return mi.Vector2f(mi.Float(index - row * width), mi.Float(row))
