"""The projector's light on surfaces, as Dr.Jit values."""

from __future__ import annotations

import operator
from dataclasses import dataclass
from functools import reduce
from typing import Any

import numpy as np
from numpy.typing import NDArray

from starling.sim.geometry import frames
from starling.sim.geometry.frames import Pose
from starling.sim.render import backend
from starling.sim.render import emission as projector
from starling.sim.render.mitsuba_scene import Stage
from starling.sim.render.rays import Placed, opaque
from starling.sim.sensor.sensor import Projector, Sensor


class _Focused:
    """A pattern whose dots have one width at all distances."""

    def __init__(self, irradiance: NDArray[np.float32]) -> None:
        self._texture = _texture("Texture2f", irradiance)

    def irradiance(self, texel: Any, _depth: Any, active: Any) -> Any:
        """Irradiance on the plane at unit distance at image coordinates from 0 to 1."""
        return self._texture.eval(texel, active)[0]


class _Defocused:
    """A pattern whose dots widen off the distance in focus."""

    def __init__(self, part: Projector, number: int) -> None:
        made = projector.defocused(part, number)
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
class Emission:
    """What one emitter throws, in its own frame."""

    half_tangent: Any  # Vector2f
    pattern: _Focused | _Defocused
    scale: Any | None  # Float: direction cosines over the pattern's; None where they are these.

    @staticmethod
    def of(part: Projector, number: int) -> Emission:
        return Emission(
            opaque("Vector2f", projector.half_tangents(part)),
            _Defocused(part, number)
            if part.defocus_mrad_m
            else _Focused(projector.irradiance_at_unit_distance(part, number)),
            opaque("Float", [part.pattern_scale]) if part.pattern_scale != 1 else None,
        )

    def covers(self, local: Any) -> Any:
        """Whether points of the emitter's frame are inside its field."""
        nominal = self._nominal(local)
        slope_x, slope_y = nominal.x / nominal.z, nominal.y / nominal.z
        inside = (abs(slope_x) <= self.half_tangent.x) & (abs(slope_y) <= self.half_tangent.y)
        return inside & (local.z > 0)

    def irradiance(self, local: Any, active: Any) -> Any:
        """Irradiance [W m^-2] at points of the emitter's frame, of planes across its axis.

        At scale s a pencil of light with the direction cosines a, b and the angle t0 off the axis
        leaves with s a, s b at angle t. Of the plane at unit distance it crosses, instead of
        da db / cos^4 t0, s^2 da db / cos^4 t: so the plane has 1 / s^2 (cos t / cos t0)^4 of the
        pattern's irradiance.
        """
        mi, dr = backend.mitsuba(), backend.drjit()
        nominal = self._nominal(local)
        slope = mi.Point2f(nominal.x, nominal.y) / nominal.z
        texel = 0.5 * (slope / self.half_tangent + 1)
        plane = self.pattern.irradiance(texel, local.z, active) / dr.square(local.z)
        if self.scale is None:
            return plane
        return plane * dr.square(dr.square(local.z / nominal.z) / self.scale)

    def _nominal(self, local: Any) -> Any:
        """Where light that gets to a point would be at scale 1, as far from the emitter.

        Beyond a sine of the scale there is no light; z is 0 there.
        """
        if self.scale is None:
            return local
        dr = backend.drjit()
        x, y = local.x / self.scale, local.y / self.scale
        rest = dr.squared_norm(local) - dr.square(x) - dr.square(y)
        return type(local)(x, y, dr.sqrt(dr.maximum(rest, 0)))


@dataclass(frozen=True, slots=True)
class Beam:
    """What one emitter throws into the world."""

    emission: Emission
    place: Placed

    def passed(self, stage: Stage, point: Any, active: Any) -> Any:
        """Share of the light towards a point that gets there; 0 where the field ends."""
        covered = active & self.emission.covers(self.place.local(point))
        return stage.passed(
            between(self.place.origin, point, stage.scene.shadow_tolerance), covered
        )

    def returned(self, stage: Stage, si: Any) -> Any:
        """Radiance that surface points return of the emitter's direct light [W m^-2 sr^-1].

        The plane at distance z in front of the emitter receives E1 / z^2, E1 being the pattern's
        irradiance at unit distance; a surface turned by theta from the ray, which leaves at angle
        alpha from the axis, receives cos theta / cos alpha times that.
        """
        mi, dr = backend.mitsuba(), backend.drjit()
        local = self.place.local(si.p)
        toward = -dr.normalize(si.p - self.place.origin)
        share = self.passed(stage, si.p, si.is_valid())
        lit = share > 0
        plane = self.emission.irradiance(local, lit)
        cos_alpha = local.z / dr.norm(local)
        brdf_cos = si.bsdf().eval(mi.BSDFContext(), si, si.to_local(toward), lit)[0]
        return dr.select(lit, brdf_cos * plane / cos_alpha * share, 0)


@dataclass(frozen=True, slots=True)
class Light:
    """The projector in the world, and its emitters on it."""

    emissions: tuple[Emission, ...]
    places: tuple[Placed | None, ...]  # Of the emitters, in its frame; None is its own place.
    place: Placed

    @staticmethod
    def of(sensor: Sensor, world_from_left: Pose) -> Light:
        part = sensor.projector
        own = [frames.pose(e.offset_m, e.rotation_deg) for e in projector.emitters(part)]
        return Light(
            tuple(Emission.of(part, number) for number in range(len(own))),
            tuple(None if np.array_equal(pose, np.eye(4)) else Placed.of(pose) for pose in own),
            Placed.of(world_from_left @ frames.pose(part.position_m, part.rotation_deg)),
        )

    @property
    def beams(self) -> list[Beam]:
        """The light of every emitter."""
        places = (_on(self.place, place) if place else self.place for place in self.places)
        return [Beam(*pair) for pair in zip(self.emissions, places, strict=True)]

    def reaches(self, stage: Stage, point: Any, active: Any) -> Any:
        """Whether the light of any emitter gets to a point."""
        return reduce(operator.or_, (beam.passed(stage, point, active) > 0 for beam in self.beams))

    def returned(self, stage: Stage, si: Any) -> Any:
        """Radiance that surface points return of the light of all emitters [W m^-2 sr^-1]."""
        first, *others = (beam.returned(stage, si) for beam in self.beams)
        return sum(others, start=first)


def _on(projector_place: Placed, place: Placed) -> Placed:
    """Place in the world of what stands on a projector."""

    def turned(vector: Any) -> Any:
        axes = projector_place.x, projector_place.y, projector_place.z
        return axes[0] * vector.x + axes[1] * vector.y + axes[2] * vector.z

    origin = projector_place.origin + turned(place.origin)
    return Placed(turned(place.x), turned(place.y), turned(place.z), origin)


def _texture(kind: str, image: NDArray[np.float32]) -> Any:
    """Linearly interpolated texture; not the GPU's own units, whose fractions have 8 bits."""
    mi = backend.mitsuba()
    return getattr(mi, kind)(mi.TensorXf(image[..., None]), use_accel=False)


def between(origin: Any, point: Any, tolerance: float) -> Any:
    """Ray from origin to point, up to a share `tolerance` of its length."""
    mi, dr = backend.mitsuba(), backend.drjit()
    along = point - origin
    distance = dr.norm(along)
    ray = mi.Ray3f(origin, along / distance)
    ray.maxt = distance * (1 - tolerance)
    return ray
