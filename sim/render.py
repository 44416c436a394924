"""Scene and sensor to layers: one traced pass a view, no Monte-Carlo noise in direct light.

Every pixel is sampled at n x n fixed sub-pixel positions (box filter). At each the surface is
found by one ray from the imager and the projector's light by one ray *from the projector*, so
that a surface with noise does not shadow itself. Where no compiler is, `sim.render_scalar` makes
the same layers with Mitsuba's own integrators.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim import backend, frames, projector
from sim.frames import Pose
from sim.layers import Layers, Truth, View
from sim.sensor import Sensor
from sim.stage import Stage


def layers(stage: Stage, sensor: Sensor, *, subpixels: int = 2) -> Layers:
    """Render what both imagers of a sensor receive, and the truth.

    Args:
        stage: the scene in Mitsuba; its `world_from_left` poses the sensor.
        sensor: geometry and projector; the projector's power is in the layers.
        subpixels: n of the n x n fixed positions in a pixel.

    Returns:
        Layers with zero indirect light (see `sim.indirect`).
    """
    if not backend.is_jit():
        from sim import render_scalar

        return render_scalar.layers(stage, sensor, subpixels=subpixels)
    left, right = cameras(sensor, stage.scene.world_from_left)
    light = Light.of(sensor, stage.scene.world_from_left)
    return Layers(
        left=_view(stage, left, light, subpixels),
        right=_view(stage, right, light, subpixels),
        truth=_truth(stage, left, right, light),
    )


@dataclass(frozen=True, slots=True)
class Placed:
    """A part's place in the world as opaque device values: moving it recompiles nothing."""

    x: Any
    y: Any
    z: Any
    origin: Any

    @staticmethod
    def of(world_from_part: Pose) -> Placed:
        x, y, z = (_opaque("Vector3f", world_from_part[:3, i]) for i in range(3))
        return Placed(x, y, z, _opaque("Point3f", world_from_part[:3, 3]))

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


@dataclass(frozen=True, slots=True)
class Light:
    """The projector in the world."""

    half_tangent: Any  # Vector2f
    irradiance: Any  # Texture [W m^-2] on the plane at unit distance, over the field
    place: Placed

    @staticmethod
    def of(sensor: Sensor, world_from_left: Pose) -> Light:
        part = sensor.projector
        return Light(
            _opaque("Vector2f", projector.half_tangents(part)),
            _texture(projector.irradiance_at_unit_distance(part)),
            Placed.of(world_from_left @ frames.pose(part.position_m, part.rotation_deg)),
        )

    def reaches(self, scene: Any, point: Any, active: Any, tolerance: float) -> Any:
        """Whether nothing stands between projector and point, and the field covers it."""
        local = self.place.local(point)
        slope_x, slope_y = local.x / local.z, local.y / local.z
        inside = (abs(slope_x) <= self.half_tangent.x) & (abs(slope_y) <= self.half_tangent.y)
        return clear(scene, self.place.origin, point, active & inside & (local.z > 0), tolerance)


def _opaque(kind: str, values: Any) -> Any:
    dr = backend.drjit()
    value = getattr(backend.mitsuba(), kind)(*(float(v) for v in values))
    dr.make_opaque(value)
    return value


def _texture(image: NDArray[np.float32]) -> Any:
    """Bilinear texture; not the GPU's own units, whose fractions have 8 bits."""
    mi = backend.mitsuba()
    return mi.Texture2f(mi.TensorXf(image[..., None]), use_accel=False)


def cameras(sensor: Sensor, world_from_left: Pose) -> tuple[Camera, Camera]:
    """The left and the right imager in the world."""
    focal = _opaque("Vector2f", (sensor.fx_px, sensor.fy_px))
    centre = _opaque("Vector2f", (sensor.cx_px, sensor.cy_px))
    size = (sensor.width, sensor.height)
    world_from_right = frames.right_of(world_from_left, sensor.baseline_m)
    return (
        Camera(size, focal, centre, Placed.of(world_from_left)),
        Camera(size, focal, centre, Placed.of(world_from_right)),
    )


def clear(scene: Any, origin: Any, point: Any, active: Any, tolerance: float) -> Any:
    """Whether the way from origin to point is free, up to a share `tolerance` of its length."""
    mi, dr = backend.mitsuba(), backend.drjit()
    way = point - origin
    distance = dr.norm(way)
    ray = mi.Ray3f(origin, way / distance)
    ray.maxt = distance * (1 - tolerance)
    return active & ~scene.ray_test(ray, active)


def pixels(size: tuple[int, int]) -> Any:
    """Image coordinates of all pixel centres, row by row (Vector2f)."""
    mi, dr = backend.mitsuba(), backend.drjit()
    width, height = size
    index = dr.arange(mi.UInt32, width * height)
    row = index // width
    return mi.Vector2f(mi.Float(index - row * width), mi.Float(row))


def projected(stage: Stage, light: Light, si: Any) -> Any:
    """Radiance that surface points return of the projector's direct light [W m^-2 sr^-1].

    The plane at distance z in front of the projector receives E1 / z^2, E1 being the pattern's
    irradiance at unit distance; a surface turned by theta from the ray, which leaves at angle
    alpha from the axis, receives cos theta / cos alpha times that.
    """
    mi, dr = backend.mitsuba(), backend.drjit()
    local = light.place.local(si.p)
    toward = -dr.normalize(si.p - light.place.origin)
    active = light.reaches(stage.mitsuba, si.p, si.is_valid(), stage.scene.shadow_tolerance)
    slope = mi.Point2f(local.x, local.y) / local.z
    texel = 0.5 * (slope / light.half_tangent + 1)
    plane = light.irradiance.eval(texel, active)[0] / dr.square(local.z)
    cos_alpha = local.z / dr.norm(local)
    brdf_cos = si.bsdf().eval(mi.BSDFContext(), si, si.to_local(toward), active)[0]
    return dr.select(active, brdf_cos * plane / cos_alpha, 0)


def _ambient(stage: Stage, si: Any) -> Any:
    """Radiance that surface points return of the ambient light [W m^-2 sr^-1]."""
    mi, dr = backend.mitsuba(), backend.drjit()
    ambient = stage.scene.ambient
    # A metal's diffuse equivalent exceeds 1 in Mitsuba: no surface returns more than it gets.
    albedo = dr.minimum(si.bsdf().eval_diffuse_reflectance(si, si.is_valid())[0], 1)
    normal = _towards_viewer(si)
    level = ambient.irradiance_w_m2 / np.pi
    tilt = dr.dot(normal, mi.Vector3f(*ambient.up)) * (2 / 3 * ambient.gradient)
    return dr.select(si.is_valid(), albedo * level * (1 + tilt), 0)


def _towards_viewer(si: Any) -> Any:
    dr = backend.drjit()
    normal = si.sh_frame.n
    return dr.select(dr.dot(normal, si.to_world(si.wi)) < 0, -normal, normal)


def _view(stage: Stage, camera: Camera, light: Light, subpixels: int) -> View:
    """Average n x n fixed positions a pixel; one kernel, launched n^2 times."""
    mi, dr = backend.mitsuba(), backend.drjit()
    count = camera.size[0] * camera.size[1]
    direct, ambient = dr.zeros(mi.Float, count), dr.zeros(mi.Float, count)
    for row, column in np.ndindex(subpixels, subpixels):
        shift = _opaque("Vector2f", [(i + 0.5) / subpixels - 0.5 for i in (column, row)])
        si = stage.mitsuba.ray_intersect(camera.ray(pixels(camera.size) + shift))
        direct += projected(stage, light, si)
        ambient += _ambient(stage, si)
        dr.eval(direct, ambient)
    shape, share = camera.size[::-1], np.float32(1 / subpixels**2)
    return View(
        projector_direct=direct.numpy().reshape(shape) * share,
        projector_indirect=np.zeros(shape, np.float32),
        ambient=ambient.numpy().reshape(shape) * share,
    )


def _truth(stage: Stage, left: Camera, right: Camera, light: Light) -> Truth:
    mi, dr = backend.mitsuba(), backend.drjit()
    si = stage.mitsuba.ray_intersect(left.ray(pixels(left.size)))
    hit, tolerance = si.is_valid(), stage.scene.shadow_tolerance
    normal = _towards_viewer(si)
    place = left.place
    columns = (
        left.place.local(si.p).z,
        *(dr.dot(axis, normal) for axis in (place.x, place.y, place.z)),
        dr.reinterpret_array(mi.UInt32, si.shape),
        clear(stage.mitsuba, right.place.origin, si.p, hit & right.sees(si.p), tolerance),
        light.reaches(stage.mitsuba, si.p, hit, tolerance),
        hit,
    )
    dr.eval(*columns)
    shape = left.size[::-1]
    depth, nx, ny, nz, body, right_sees, lit, seen = (c.numpy().reshape(shape) for c in columns)
    missing = np.float32(np.nan)
    return Truth(
        depth_m=np.where(seen, depth, missing).astype(np.float32),
        normal=np.where(seen[..., None], np.stack([nx, ny, nz], axis=-1), missing),
        material=np.where(seen, stage.numbers[np.minimum(body, len(stage.numbers) - 1)], 0),
        right_sees=right_sees,
        lit=lit,
    )
