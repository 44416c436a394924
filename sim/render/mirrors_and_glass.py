"""Rays through mirrors and glass, followed until they meet a scattering surface.

Rays from the imager are refracted at each face of glass and lose the light that Fresnel's equations
reflect. Only the reflection at the first face is followed. Rays from a light pass glass straight,
with the same loss. There are no caustics, and mirrors throw no light onto other surfaces.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from starling.sim.render import backend

_INTERFACES = 8  # Most interfaces on a ray, enough for two bottles.
_MEETINGS = _INTERFACES + 1  # Most intersections of a ray, with the surface behind.

Shade = Callable[[Any, Any], list[Any]]  # From surface points and a mask to radiances.
Sky = Callable[[Any], list[Any]]  # From directions of rays that leave the scene to radiances.


@dataclass(frozen=True, slots=True)
class Specular:
    """Mirrors, glass and transparent panes of a scene."""

    mirrors: Any  # Float by shape handle: reflectance of mirrors, else 0.
    indices: Any  # Float by shape handle: refractive index of glass, else 0.
    has_glass: bool
    has_panes: bool  # Some shape transmits light straight.

    @staticmethod
    def from_shapes(shapes: Sequence[Any]) -> Specular | None:
        """Classify shapes by their BSDFs; None if all of them are diffuse or rough."""
        mi = backend.mitsuba()
        flag = mi.BSDFFlags
        mirrors: dict[int, float] = {}
        glass: dict[int, float] = {}
        has_panes = False
        for shape in shapes:
            bsdf, handle = shape.bsdf(), shape_handle(shape)
            flags = int(bsdf.flags())
            if flags & int(flag.DeltaTransmission):
                glass[handle] = _index(bsdf)
            elif flags & int(flag.Null):
                has_panes = True
            elif flags & int(flag.All) == int(flag.DeltaReflection):
                mirrors[handle] = _reflectance(bsdf)
        if not (mirrors or glass or has_panes):
            return None
        size = max(map(shape_handle, shapes)) + 1
        return Specular(
            mirrors=mi.Float([mirrors.get(handle, 0.0) for handle in range(size)]),
            indices=mi.Float([glass.get(handle, 0.0) for handle in range(size)]),
            has_glass=bool(glass),
            has_panes=has_panes,
        )

    def trace(self, scene: Any, ray: Any, shade: Shade, sky: Sky) -> list[Any]:
        """Radiances along rays, including light by way of mirrors and glass.

        Args:
            scene: Mitsuba scene of all shapes.
            ray: Rays from the imager.
            shade: Reflected radiances of surface points, one per light.
            sky: Radiances that enter the scene along reflected rays, one per light.
        """
        mi, dr = backend.mitsuba(), backend.drjit()

        def step(
            active: Any, budget: Any, ray: Any, weight: Any, turned: Any, waiting: Any, *sums: Any
        ) -> tuple[Any, ...]:
            si = scene.ray_intersect(ray, active)
            hit = active & si.is_valid()
            gone = active & ~hit & turned
            lit, beyond = shade(si, hit), sky(ray.d)
            sums = tuple(
                total + dr.select(hit, weight * near, 0) + dr.select(gone, weight * far, 0)
                for total, near, far in zip(sums, lit, beyond, strict=True)
            )
            out, share, turns, aside = self._leaving(si, hit)
            weighed = weight * share
            if aside is not None:
                first = hit & (aside > 0) & waiting.unused
                waiting.ray = dr.select(first, _spawn(si, mi.reflect(si.wi)), waiting.ray)
                waiting.weight = dr.select(first, weight * aside, waiting.weight)
                waiting.unused &= ~first
            budget = budget - 1
            active = hit & (share > 0) & (budget > 0)
            ray = _spawn(si, out)
            turned = turned | (hit & turns)
            if aside is not None:
                now = ~active & (waiting.weight > 0)
                ray = dr.select(now, waiting.ray, ray)
                weighed = dr.select(now, waiting.weight, weighed)
                waiting.weight = dr.select(now, 0, waiting.weight)
                budget = dr.select(now, _MEETINGS, budget)
                active, turned = active | now, turned | now
            return active, budget, ray, weighed, turned, waiting, *sums

        width = dr.width(ray)
        first = mi.Ray3f(ray)
        state = (
            dr.full(mi.Bool, True, width),
            dr.full(mi.UInt32, _MEETINGS, width),
            first,
            dr.ones(mi.Float, width),
            dr.full(mi.Bool, False, width),
            _Waiting(first, dr.zeros(mi.Float, width), dr.full(mi.Bool, True, width)),
            *(dr.zeros(mi.Float, width) for _ in sky(ray.d)),
        )
        label = "mirrors and glass"
        return list(dr.while_loop(state, lambda active, *_: active, step, label=label)[6:])

    def transmittance(self, scene: Any, ray: Any, active: Any) -> Any:
        """Share of light that passes straight along rays to their ends; 0 if blocked.

        One scene holds opaque and transparent shapes, since OptiX supports one scene per kernel.

        Args:
            scene: Mitsuba scene of all shapes.
            ray: Rays from a light or towards it.
            active: Mask of the rays; the share of the others is 0.
        """
        mi, dr = backend.mitsuba(), backend.drjit()

        def step(going: Any, budget: Any, ray: Any, share: Any) -> tuple[Any, ...]:
            si = scene.ray_intersect(ray, going)
            going = going & si.is_valid()
            share = dr.select(going, share * self._through(si, going), share)
            budget = budget - 1
            share = dr.select(going & (budget == 0), 0, share)
            onward = si.spawn_ray(ray.d)
            onward.maxt = ray.maxt - dr.dot(onward.o - ray.o, ray.d)  # It starts past the surface.
            return going & (share > 0) & (onward.maxt > 0), budget, onward, share

        state = (
            mi.Bool(active),
            dr.full(mi.UInt32, _MEETINGS, dr.width(ray)),
            mi.Ray3f(ray),
            dr.select(active, mi.Float(1), 0),
        )
        label = "light through glass"
        return dr.while_loop(state, lambda going, *_: going, step, label=label)[-1]

    def _through(self, si: Any, active: Any) -> Any:
        """Straight transmission of a surface."""
        mi, dr = backend.mitsuba(), backend.drjit()
        share = mi.Float(0)
        if self.has_panes:
            share = si.bsdf().eval_null_transmission(si, active)[0]
        if self.has_glass:
            index = self._gather(self.indices, si, active)
            # A straight ray meets both faces of a pane from outside.
            fresnel = mi.fresnel(abs(si.wi.z), dr.maximum(index, 1))[0]
            share = dr.select(index > 0, 1 - fresnel, share)
        return share

    def _gather(self, table: Any, si: Any, active: Any) -> Any:
        mi, dr = backend.mitsuba(), backend.drjit()
        return dr.gather(mi.Float, table, dr.reinterpret_array(mi.UInt32, si.shape), active)

    def _leaving(self, si: Any, hit: Any) -> tuple[Any, Any, Any, Any | None]:
        """Continue a ray at a surface.

        Returns:
            Direction in the surface's frame, share of light in that direction, whether the ray is
            mirrored, and the share that glass reflects (None without glass).
        """
        mi, dr = backend.mitsuba(), backend.drjit()
        mirror = self._gather(self.mirrors, si, hit)
        share, turns, out, aside = mirror, mirror > 0, -si.wi, None
        if self.has_panes:
            straight = si.bsdf().eval_null_transmission(si, hit)[0]
            share = dr.select(turns, mirror, straight)
        if self.has_glass:
            index = self._gather(self.indices, si, hit)
            glass = index > 0
            fresnel, cos_t, _, eta_ti = mi.fresnel(si.wi.z, dr.maximum(index, 1))
            inside = glass & (fresnel >= 1)  # Total reflection.
            passes = glass & ~inside
            out = dr.select(passes, mi.refract(si.wi, cos_t, eta_ti), out)
            share = dr.select(glass, dr.select(inside, 1, 1 - fresnel), share)
            aside = dr.select(passes, fresnel, 0)
            turns |= inside
        return dr.select(turns, mi.reflect(si.wi), out), share, turns, aside


@dataclass
class _Waiting:
    """Reflection at the first face of glass, which is followed after the transmitted ray."""

    ray: Any
    weight: Any  # Float, 0 if no ray is waiting.
    unused: Any  # Bool: the ray has met no glass yet.


def shape_handle(shape: Any) -> int:
    """Number of a shape in kernels."""
    mi, dr = backend.mitsuba(), backend.drjit()
    return int(dr.reinterpret_array(mi.UInt32, mi.ShapePtr(shape))[0])


def _spawn(si: Any, local: Any) -> Any:
    """Ray from a surface in a direction of the surface's frame."""
    return si.spawn_ray(si.to_world(local))


def _index(bsdf: Any) -> float:
    """Refractive index of a smooth dielectric, inside over outside."""
    params = backend.mitsuba().traverse(bsdf)
    return next(float(params[key]) for key, _ in params.items() if key.endswith("eta"))


def _reflectance(bsdf: Any) -> float:
    """Reflectance of a perfect mirror at normal incidence."""
    mi, dr = backend.mitsuba(), backend.drjit()
    si = dr.zeros(mi.SurfaceInteraction3f)
    si.wi = mi.Vector3f(0, 0, 1)
    _, weight = bsdf.sample(mi.BSDFContext(), si, 0.5, mi.Point2f(0.5))
    return float(dr.slice(weight[0]))
