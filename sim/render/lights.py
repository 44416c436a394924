"""The lights of a scene, and what surface points return of each of them."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

import numpy as np

from starling.sim.render import backend
from starling.sim.render.beam import Light
from starling.sim.render.mitsuba_scene import Stage
from starling.sim.render.rays import opaque
from starling.sim.render.skylight import MATT_TILT
from starling.sim.scene.scene import Ambient, Scene, Sun
from starling.sim.sensor.sensor import Sensor


@dataclass(frozen=True, slots=True)
class Lights:
    """The sensor's projector, ambient light, and where there are any: sun, another projector."""

    projector: Light
    other: Light | None
    other_power_w: Any  # Float
    sun: _Directional | None

    @staticmethod
    def of(stage: Stage, sensor: Sensor) -> Lights:
        scene = stage.scene
        return Lights(
            projector=Light.of(sensor, scene.world_from_left),
            other=_other(scene, sensor),
            other_power_w=opaque("Float", [scene.other_projector.power_w]),
            sun=_Directional.of(scene.sun) if scene.sun.irradiance_w_m2 else None,
        )

    @property
    def count(self) -> int:
        """How many radiances `returned` gives."""
        return 2 + (self.other is not None or self.sun is not None)

    def returned(self, stage: Stage, si: Any) -> list[Any]:
        """Radiance that surface points return of the projector, of ambient light, of all others.

        The first two are for lights of unit strength, the third is left out where there are none.
        """
        parts = [self.projector.returned(stage, si), _ambient(stage, si)]
        if self.count == 2:
            return parts
        rest = backend.mitsuba().Float(0)
        if self.other is not None:
            rest = rest + self.other_power_w * self.other.returned(stage, si)
        if self.sun is not None:
            rest = rest + self.sun.returned(stage, si)
        return [*parts, rest]

    def sky(self, stage: Stage, way: Any) -> list[Any]:
        """Radiance that comes from beyond the scene against directions `way`, of each light.

        Only ambient light does: projectors and the sun are seen by what they light.
        """
        mi = backend.mitsuba()
        ambient = stage.scene.ambient
        radiance = (1 + _tilt(ambient, way, ambient.gradient)) / np.pi
        return [mi.Float(0), radiance, mi.Float(0)][: self.count]


def towards_viewer(si: Any) -> Any:
    """Normals of surface points, on the side they are seen from."""
    dr = backend.drjit()
    normal = si.sh_frame.n
    return dr.select(dr.dot(normal, si.to_world(si.wi)) < 0, -normal, normal)


@dataclass(frozen=True, slots=True)
class _Directional:
    """Light from one direction."""

    towards: Any  # Vector3f, unit
    irradiance: Any  # Float, on a surface that faces it [W m^-2]

    @staticmethod
    def of(sun: Sun) -> _Directional:
        towards = np.asarray(sun.towards) / np.linalg.norm(sun.towards)
        return _Directional(opaque("Vector3f", towards), opaque("Float", [sun.irradiance_w_m2]))

    def returned(self, stage: Stage, si: Any) -> Any:
        """Radiance that surface points return: f cos(theta) E where nothing is in the way.

        A shadow ray starts as much above the surface as `shadow_tolerance` allows of the way to
        the imager, for surfaces measured with noise would otherwise shadow themselves.
        """
        mi, dr = backend.mitsuba(), backend.drjit()
        ray = si.spawn_ray(self.towards)
        ray.o += self.towards * (si.t * stage.scene.shadow_tolerance)
        share = stage.passed(ray, si.is_valid())
        lit = share > 0
        brdf_cos = si.bsdf().eval(mi.BSDFContext(), si, si.to_local(self.towards), lit)[0]
        return dr.select(lit, brdf_cos * self.irradiance * share, 0)


def _other(scene: Scene, sensor: Sensor) -> Light | None:
    """Another device's projector, as if it were a stereo camera's."""
    if not scene.other_projector.power_w:
        return None
    device = dataclasses.replace(sensor, kind="stereo", projector=scene.other_projector)
    return Light.of(device, scene.world_from_left)


def _ambient(stage: Stage, si: Any) -> Any:
    """Radiance that surface points return of ambient light of 1 W m^-2 [W m^-2 sr^-1]."""
    mi, dr = backend.mitsuba(), backend.drjit()
    ambient = stage.scene.ambient
    albedo, normal = stage.albedo(si), towards_viewer(si)
    local = stage.ambient_share(si)
    if stage.skylight is None:
        share = albedo * (1 + _tilt(ambient, normal, MATT_TILT * ambient.gradient))
        return dr.select(si.is_valid(), share * local / np.pi, 0)
    viewer = si.to_world(si.wi)
    cosine = dr.dot(normal, viewer)
    across = normal * cosine - viewer  # Along the surface, on from the viewer.
    across /= dr.maximum(dr.norm(across), 1e-6)
    handle = dr.reinterpret_array(mi.UInt32, si.shape)
    even, along, aside = stage.skylight.returned(handle, cosine, albedo, stage.opaque(si))
    share = even + _tilt(ambient, normal * along + across * aside, ambient.gradient)
    return dr.select(si.is_valid(), dr.maximum(share, 0) * local / np.pi, 0)


def _tilt(ambient: Ambient, direction: Any, gradient: float) -> Any:
    """How much more light than the mean comes from, or falls on what faces, a direction."""
    # Opaque: another gradient, or another up, recompiles nothing.
    along = backend.drjit().dot(direction, opaque("Vector3f", ambient.up))
    return along * opaque("Float", [gradient])
