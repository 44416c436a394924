"""The projector's light on surfaces, computed with Dr.Jit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from starling.sim.geometry import frames
from starling.sim.geometry.frames import Pose
from starling.sim.render import backend, emission
from starling.sim.render.mitsuba_scene import MitsubaScene
from starling.sim.render.rays import JitPose, opaque
from starling.sim.sensor.sensor import Projector, Sensor


class FocusedPattern:
    """A pattern with the same dot width at all distances."""

    def __init__(self, irradiance: NDArray[np.float32]) -> None:
        self._texture = _texture("Texture2f", irradiance)

    def irradiance(self, texel: Any, _depth: Any, active: Any) -> Any:
        """Irradiance on the plane at unit distance at image coordinates from 0 to 1."""
        return self._texture.eval(texel, active)[0]


class _Defocused:
    """A pattern whose dots widen away from the distance in focus."""

    def __init__(self, part: Projector, number: int) -> None:
        defocus = emission.defocus_levels(part, number)
        self._texture = _texture("Texture3f", defocus.levels)
        self._last = opaque("Float", [len(defocus.levels) - 1])
        relative = part.defocus_mrad_m / np.sqrt(defocus.variance_mrad2)
        self._focus = opaque("Vector2f", (relative, 1 / part.focus_m))
        self._ratio = defocus.ratio

    def irradiance(self, texel: Any, depth: Any, active: Any) -> Any:
        """As `FocusedPattern.irradiance`; variances between two levels are interpolated."""
        mi, dr = backend.mitsuba(), backend.drjit()
        nearness = 1 / dr.maximum(depth, emission.NEAREST_M)
        variance = 1 + dr.square(self._focus.x * (nearness - self._focus.y))
        below = dr.floor(dr.log(variance) / np.log(self._ratio))
        share = (variance * dr.power(self._ratio, -below) - 1) / (self._ratio - 1)
        level = dr.clip(below + dr.clip(share, 0, 1), 0, self._last)
        layer = (level + 0.5) / (self._last + 1)
        return self._texture.eval(mi.Point3f(texel.x, texel.y, layer), active)[0]


@dataclass(frozen=True, slots=True)
class EmittedPattern:
    """Light of one emitter, in the emitter's frame."""

    half_tangent: Any  # Vector2f
    pattern: FocusedPattern | _Defocused
    scale: Any | None  # Float: direction cosines over the pattern's; None is 1.

    @staticmethod
    def from_projector(part: Projector, number: int) -> EmittedPattern:
        return EmittedPattern(
            opaque("Vector2f", emission.half_tangents(part)),
            _Defocused(part, number)
            if part.defocus_mrad_m
            else FocusedPattern(emission.irradiance_at_unit_distance(part, number)),
            opaque("Float", [part.pattern_scale]) if part.pattern_scale != 1 else None,
        )

    def covers(self, local: Any) -> Any:
        """Whether points in the emitter's frame are inside its field."""
        nominal = self._nominal(local)
        slope_x, slope_y = nominal.x / nominal.z, nominal.y / nominal.z
        inside = (abs(slope_x) <= self.half_tangent.x) & (abs(slope_y) <= self.half_tangent.y)
        return inside & (local.z > 0)

    def irradiance(self, local: Any, active: Any) -> Any:
        """Irradiance [W m^-2] of planes across the axis, at points in the emitter's frame.

        Scale s changes direction cosines a, b at angle t0 to s a, s b at angle t. The light's area
        on the plane at unit distance changes from da db / cos^4 t0 to s^2 da db / cos^4 t. The
        irradiance is therefore 1 / s^2 (cos t / cos t0)^4 times the pattern's.
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
        """Point at the same distance that the same light would reach at scale 1.

        z is 0 where the sine of the angle exceeds the scale, since no light goes there.
        """
        if self.scale is None:
            return local
        dr = backend.drjit()
        x, y = local.x / self.scale, local.y / self.scale
        rest = dr.squared_norm(local) - dr.square(x) - dr.square(y)
        return type(local)(x, y, dr.sqrt(dr.maximum(rest, 0)))


@dataclass(frozen=True, slots=True)
class Beam:
    """Light of one emitter in the world frame."""

    emission: EmittedPattern
    place: JitPose

    def transmittance(self, mi_scene: MitsubaScene, si: Any, *, coherent: bool) -> Any:
        """Share of the light that reaches surface points; 0 outside the field."""
        covered = si.is_valid() & self.emission.covers(self.place.local(si.p))
        ray = shadow_ray(self.place.origin, si.p, mi_scene.scene.shadow_tolerance)
        return mi_scene.transmittance(ray, covered, coherent=coherent)

    def reflected(self, si: Any, share: Any) -> Any:
        """Radiance of the emitter's direct light reflected by surface points [W m^-2 sr^-1].

        The plane at distance z in front of the emitter receives E1 / z^2, where E1 is the
        pattern's irradiance at unit distance. A surface at angle theta to the ray receives
        cos theta / cos alpha times that, where alpha is the ray's angle to the axis.

        Args:
            si: Surface points.
            share: Share of the light that reaches them (see `transmittance`).
        """
        mi, dr = backend.mitsuba(), backend.drjit()
        local = self.place.local(si.p)
        toward = -dr.normalize(si.p - self.place.origin)
        lit = share > 0
        plane = self.emission.irradiance(local, lit)
        cos_alpha = local.z / dr.norm(local)
        brdf_cos = si.bsdf().eval(mi.BSDFContext(), si, si.to_local(toward), lit)[0]
        return dr.select(lit, brdf_cos * plane / cos_alpha * share, 0)


@dataclass(frozen=True, slots=True)
class ProjectorLight:
    """Light of the projector with all its emitters, in the world frame."""

    emissions: tuple[EmittedPattern, ...]
    places: tuple[JitPose | None, ...]  # Poses of the emitters in its frame; None is the identity.
    place: JitPose

    @staticmethod
    def from_sensor(sensor: Sensor, world_from_left: Pose) -> ProjectorLight:
        part = sensor.projector
        poses = [frames.pose(e.offset_m, e.rotation_deg) for e in emission.emitters(part)]
        return ProjectorLight(
            tuple(EmittedPattern.from_projector(part, number) for number in range(len(poses))),
            tuple(
                None if np.array_equal(pose, np.eye(4)) else JitPose.from_pose(pose)
                for pose in poses
            ),
            JitPose.from_pose(world_from_left @ frames.pose(part.position_m, part.rotation_deg)),
        )

    @property
    def beams(self) -> list[Beam]:
        """Beams of all emitters."""
        places = (_compose(self.place, place) if place else self.place for place in self.places)
        return [Beam(*pair) for pair in zip(self.emissions, places, strict=True)]

    def shares(self, mi_scene: MitsubaScene, si: Any, *, coherent: bool = False) -> list[Any]:
        """Share of each emitter's light that reaches surface points.

        Args:
            mi_scene: Scene that casts shadows.
            si: Surface points.
            coherent: Whether adjacent points are close, as those of an image.
        """
        return [beam.transmittance(mi_scene, si, coherent=coherent) for beam in self.beams]

    def reflected(self, si: Any, shares: Sequence[Any]) -> Any:
        """Radiance of all emitters' light reflected by surface points [W m^-2 sr^-1].

        Args:
            si: Surface points.
            shares: Share of each emitter's light that reaches them (see `shares`).
        """
        pairs = zip(self.beams, shares, strict=True)
        first, *rest = (beam.reflected(si, share) for beam, share in pairs)
        return sum(rest, start=first)


def _compose(projector_place: JitPose, place: JitPose) -> JitPose:
    """World pose of an emitter from its pose on the projector."""

    def rotate(vector: Any) -> Any:
        axes = projector_place.x, projector_place.y, projector_place.z
        return axes[0] * vector.x + axes[1] * vector.y + axes[2] * vector.z

    origin = projector_place.origin + rotate(place.origin)
    return JitPose(rotate(place.x), rotate(place.y), rotate(place.z), origin)


def _texture(kind: str, image: NDArray[np.float32]) -> Any:
    """Linearly interpolated texture, without GPU texture units, whose weights have 8 bits."""
    mi = backend.mitsuba()
    return getattr(mi, kind)(mi.TensorXf(image[..., None]), use_accel=False)


def shadow_ray(origin: Any, point: Any, tolerance: float) -> Any:
    """Ray from origin to point that ends a share `tolerance` of its length early."""
    mi, dr = backend.mitsuba(), backend.drjit()
    along = point - origin
    distance = dr.norm(along)
    ray = mi.Ray3f(origin, along / distance)
    ray.maxt = distance * (1 - tolerance)
    return ray
