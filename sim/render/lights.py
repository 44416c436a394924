"""The lights of a scene, and their radiance reflected by surface points."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from starling.sim.render import backend
from starling.sim.render.beam import ProjectorLight
from starling.sim.render.mitsuba_scene import MitsubaScene
from starling.sim.render.rays import opaque
from starling.sim.render.skylight import MATT_TILT
from starling.sim.scene.scene import Ambient, Scene, Sun
from starling.sim.sensor.sensor import Sensor


@dataclass(frozen=True, slots=True)
class Lights:
    """The sensor's projector, ambient light, and optionally sun and another projector."""

    projector: ProjectorLight
    other_projector: ProjectorLight | None
    other_power_w: Any  # Float
    sun: _Directional | None

    @staticmethod
    def from_sensor(mi_scene: MitsubaScene, sensor: Sensor) -> Lights:
        scene = mi_scene.scene
        return Lights(
            projector=ProjectorLight.from_sensor(sensor, scene.world_from_left),
            other_projector=_other_projector(scene, sensor),
            other_power_w=opaque("Float", [scene.other_projector.power_w]),
            sun=_Directional.from_sun(scene.sun) if scene.sun.irradiance_w_m2 else None,
        )

    @property
    def count(self) -> int:
        """Number of radiances of `reflected`."""
        return 2 + (self.other_projector is not None or self.sun is not None)

    def reflected(
        self, mi_scene: MitsubaScene, si: Any, shares: Sequence[Any] | None = None
    ) -> list[Any]:
        """Reflected radiance of the projector, of ambient light, and of all other lights.

        The first two are for lights of unit strength. The third is omitted without other lights.

        Args:
            mi_scene: Scene with its surfaces.
            si: Surface points.
            shares: Shares of the projector's light that reach them, if they are known.
        """
        if shares is None:
            shares = self.projector.shares(mi_scene, si)
        parts = [self.projector.reflected(si, shares), _ambient(mi_scene, si)]
        if self.count == 2:
            return parts
        rest = backend.mitsuba().Float(0)
        if self.other_projector is not None:
            other = self.other_projector
            rest += self.other_power_w * other.reflected(si, other.shares(mi_scene, si))
        if self.sun is not None:
            rest = rest + self.sun.reflected(mi_scene, si)
        return [*parts, rest]

    def sky(self, mi_scene: MitsubaScene, direction: Any) -> list[Any]:
        """Radiance of each light on rays of this direction that leave the scene.

        Only ambient light contributes, since projectors and sun are not visible themselves.
        """
        mi = backend.mitsuba()
        ambient = mi_scene.scene.ambient
        radiance = (1 + sky_excess(ambient, direction, ambient.gradient)) / np.pi
        return [mi.Float(0), radiance, mi.Float(0)][: self.count]


def towards_viewer(si: Any) -> Any:
    """Normals of surface points on the visible side."""
    dr = backend.drjit()
    normal = si.sh_frame.n
    return dr.select(dr.dot(normal, si.to_world(si.wi)) < 0, -normal, normal)


@dataclass(frozen=True, slots=True)
class _Directional:
    """Light from one direction."""

    towards: Any  # Vector3f, unit
    irradiance: Any  # Float, on a surface that faces it [W m^-2]

    @staticmethod
    def from_sun(sun: Sun) -> _Directional:
        towards = np.asarray(sun.towards) / np.linalg.norm(sun.towards)
        return _Directional(opaque("Vector3f", towards), opaque("Float", [sun.irradiance_w_m2]))

    def reflected(self, mi_scene: MitsubaScene, si: Any) -> Any:
        """Reflected radiance: f cos(theta) E on unshadowed points.

        Shadow rays start above the surface, by `shadow_tolerance` times the distance to the
        imager. Surfaces measured with noise would otherwise shadow themselves.
        """
        mi, dr = backend.mitsuba(), backend.drjit()
        ray = si.spawn_ray(self.towards)
        ray.o += self.towards * (si.t * mi_scene.scene.shadow_tolerance)
        share = mi_scene.transmittance(ray, si.is_valid())
        lit = share > 0
        brdf_cos = si.bsdf().eval(mi.BSDFContext(), si, si.to_local(self.towards), lit)[0]
        return dr.select(lit, brdf_cos * self.irradiance * share, 0)


def _other_projector(scene: Scene, sensor: Sensor) -> ProjectorLight | None:
    """Another device's projector, treated as a stereo camera's."""
    if not scene.other_projector.power_w:
        return None
    device = dataclasses.replace(sensor, kind="stereo", projector=scene.other_projector)
    return ProjectorLight.from_sensor(device, scene.world_from_left)


def _ambient(mi_scene: MitsubaScene, si: Any) -> Any:
    """Reflected radiance of ambient light of 1 W m^-2 [W m^-2 sr^-1]."""
    mi, dr = backend.mitsuba(), backend.drjit()
    ambient = mi_scene.scene.ambient
    albedo, normal = mi_scene.albedo(si), towards_viewer(si)
    local = mi_scene.ambient_share(si)
    if mi_scene.skylight is None:
        share = albedo * (1 + sky_excess(ambient, normal, MATT_TILT * ambient.gradient))
        return dr.select(si.is_valid(), share * local / np.pi, 0)
    viewer = si.to_world(si.wi)
    cosine = dr.dot(normal, viewer)
    across = normal * cosine - viewer  # Along the surface, away from the viewer.
    across /= dr.maximum(dr.norm(across), 1e-6)
    handle = dr.reinterpret_array(mi.UInt32, si.shape)
    even, along, aside = mi_scene.skylight.reflected(handle, cosine, albedo, mi_scene.opaque(si))
    share = even + sky_excess(ambient, normal * along + across * aside, ambient.gradient)
    return dr.select(si.is_valid(), dr.maximum(share, 0) * local / np.pi, 0)


def sky_excess(ambient: Ambient, direction: Any, gradient: float) -> Any:
    """Relative excess of ambient light in a direction, g w . up."""
    # Opaque values, so that another gradient or up direction does not recompile kernels.
    along = backend.drjit().dot(direction, opaque("Vector3f", ambient.up))
    return along * opaque("Float", [gradient])
