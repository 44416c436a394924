"""The projector's light on surfaces, as Dr.Jit values."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim import backend, frames, projector
from sim.camera import Placed, opaque
from sim.frames import Pose
from sim.sensor import Projector, Sensor
from sim.stage import Stage


class _Focused:
    """A pattern whose dots have one angular width at all distances."""

    def __init__(self, part: Projector) -> None:
        self._texture = _texture("Texture2f", projector.irradiance_at_unit_distance(part))

    def irradiance(self, texel: Any, _depth: Any, active: Any) -> Any:
        """Irradiance on the plane at unit distance at image coordinates from 0 to 1."""
        return self._texture.eval(texel, active)[0]


class _Defocused:
    """A pattern whose dots widen off the distance in focus."""

    def __init__(self, part: Projector) -> None:
        made = projector.defocused(part)
        self._texture = _texture("Texture3f", made.levels)
        self._last = opaque("Float", [len(made.levels) - 1])
        relative = part.defocus_mrad_m / np.sqrt(made.variance_mrad2)
        self._focus = opaque("Vector2f", (relative, 1 / part.focus_m))
        self._ratio = made.ratio

    def irradiance(self, texel: Any, depth: Any, active: Any) -> Any:
        """As of a focused pattern; variances between two levels are mixed linearly."""
        mi, dr = backend.mitsuba(), backend.drjit()
        nearness = 1 / dr.maximum(depth, projector.NEAREST_M)
        variance = 1 + dr.square(self._focus.x * (nearness - self._focus.y))
        below = dr.floor(dr.log(variance) / np.log(self._ratio))
        share = (variance * dr.power(self._ratio, -below) - 1) / (self._ratio - 1)
        level = dr.clip(below + dr.clip(share, 0, 1), 0, self._last)
        place = (level + 0.5) / (self._last + 1)
        return self._texture.eval(mi.Point3f(texel.x, texel.y, place), active)[0]


@dataclass(frozen=True, slots=True)
class Light:
    """The projector in the world."""

    half_tangent: Any  # Vector2f
    pattern: _Focused | _Defocused
    place: Placed

    @staticmethod
    def of(sensor: Sensor, world_from_left: Pose) -> Light:
        part = sensor.projector
        return Light(
            opaque("Vector2f", projector.half_tangents(part)),
            _Defocused(part) if part.defocus_mrad_m else _Focused(part),
            Placed.of(world_from_left @ frames.pose(part.position_m, part.rotation_deg)),
        )

    def reaches(self, scene: Any, point: Any, active: Any, tolerance: float) -> Any:
        """Whether nothing stands between projector and point, and the field covers it."""
        local = self.place.local(point)
        slope_x, slope_y = local.x / local.z, local.y / local.z
        inside = (abs(slope_x) <= self.half_tangent.x) & (abs(slope_y) <= self.half_tangent.y)
        return clear(scene, self.place.origin, point, active & inside & (local.z > 0), tolerance)


def _texture(kind: str, image: NDArray[np.float32]) -> Any:
    """Linearly interpolated texture; not the GPU's own units, whose fractions have 8 bits."""
    mi = backend.mitsuba()
    return getattr(mi, kind)(mi.TensorXf(image[..., None]), use_accel=False)


def clear(scene: Any, origin: Any, point: Any, active: Any, tolerance: float) -> Any:
    """Whether the way from origin to point is free, up to a share `tolerance` of its length."""
    mi, dr = backend.mitsuba(), backend.drjit()
    way = point - origin
    distance = dr.norm(way)
    ray = mi.Ray3f(origin, way / distance)
    ray.maxt = distance * (1 - tolerance)
    return active & ~scene.ray_test(ray, active)


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
    plane = light.pattern.irradiance(texel, local.z, active) / dr.square(local.z)
    cos_alpha = local.z / dr.norm(local)
    brdf_cos = si.bsdf().eval(mi.BSDFContext(), si, si.to_local(toward), active)[0]
    return dr.select(active, brdf_cos * plane / cos_alpha, 0)
