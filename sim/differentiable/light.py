"""The projector's light in one imager, and its derivatives by the rig's geometry.

Rays find the surface; the points they find are then attached to the parameters by cutting each ray
with the plane of the facet it met, so that derivatives run from the pixel over the surface
into the projector's pattern. Which facet is met, what stands in the way of the light, and how
much the surface reflects are taken as fixed: a derivative says nothing of pixels on a depth edge or
on a shadow's edge, which `Traced.clear` leaves out, nor of texture that moves.

Few parameters and many pixels: columns by forward mode, one for each parameter, all in one kernel
and exact to float. Backward mode (`Traced.pulled`) gives the same numbers, summed over pixels.

Source: forward and backward mode on one graph: Jakob et al., "Dr.Jit", ACM TOG 41(4), 2022.
"""

from __future__ import annotations

import operator
from collections.abc import Mapping
from dataclasses import dataclass
from functools import reduce
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from starling.patterns import errors
from starling.sim.differentiable.rig import AXES, RAY, Rig, Steps
from starling.sim.geometry.motion import moments
from starling.sim.geometry.pinhole import Pinhole
from starling.sim.render import backend
from starling.sim.render.beam import Light, between
from starling.sim.render.layers import Image, Mask
from starling.sim.render.lights import towards_viewer
from starling.sim.render.mitsuba_scene import Stage
from starling.sim.render.rays import Placed, opaque, pixels
from starling.sim.scene.scene import ModelError
from starling.sim.sensor.sensor import Sensor

Side = Literal["left", "right"]

PARAMETERS = (
    "fx_px",  # fy_px keeps its ratio to it.
    "cx_px",
    "cy_px",
    "baseline_m",
    *(f"projector.position_m.{axis}" for axis in AXES),
    *(f"projector.rotation_deg.{axis}" for axis in AXES),
    "projector.field",  # Relative step of the tangents of both half fields.
    "projector.pattern_scale",
    *RAY,
)
_GRAZING = 0.1  # Cosine of incidence below which a facet's plane says little of its neighbours.
_TRANSPARENT = ("mirror", "glass")  # What these show lies elsewhere.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Linear:
    """An image and how it changes."""

    image: Image  # (h, w)
    columns: Mapping[str, Image]  # Derivative by each parameter, (h, w) each.


@dataclass(frozen=True, slots=True)
class _Hits:
    """What the rays at one place in every pixel found."""

    pixel: Any  # Vector2f
    point: Any  # Vector3f, left frame, as the surface is traced
    normal: Any  # Vector3f, of the facet
    shading: Any  # Vector3f, of the surface as shaded
    returned: tuple[Any, ...]  # Float an emitter: BRDF times cosine of its light [1 / sr]
    lit: tuple[Any, ...]  # Bool an emitter


def trace(
    stage: Stage,
    sensor: Sensor,
    side: Side,
    *,
    subpixels: int = 2,
    reference: Pinhole | None = None,
) -> Traced:
    """Find what the pixels of one imager see, and whether the projector lights it.

    Args:
        stage: the scene in Mitsuba, at rest and without errors of its model.
        sensor: geometry and projector; the alignment of its imagers is left out, as it moves the
            image that is rendered here (see `starling.sim.imaging.optics.alignment`).
        side: which imager.
        subpixels: n of the n x n fixed positions in a pixel.
        reference: pinhole by which a reference depth map became the stage's surface, whose
            points then keep their pixel in the left image and move sideways with focal length
            and principal point. None for a surface known in metres.

    Raises:
        BackendError: in a variant that does not differentiate.
        InputError: if scene or sensor carry an error of their geometry beside it.
    """
    _refuse_undifferentiable(stage, sensor)
    rig = Rig.of(sensor, right=side == "right", reference=reference, steps=Steps({}))
    light = Light.of(sensor, stage.scene.world_from_left)
    shifts = [(x, y) for x, y, _ in moments(subpixels, None)]
    hits, whole = [], np.ones((sensor.height, sensor.width), bool)
    depth = body = None
    for shift in shifts:
        found, seen_depth, seen_body, plain = _hits(stage, rig, light, shift)
        hits.append(found)
        depth = seen_depth if depth is None else depth
        body = seen_body if body is None else body
        whole &= plain & (seen_body == body)
    assert depth is not None and body is not None  # There is at least one place in a pixel.
    return Traced(
        sensor=sensor,
        side=side,
        reference=reference,
        depth_m=depth,
        body=body,
        clear=whole,
        _light=light,
        _hits=tuple(hits),
    )


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Traced:
    """One imager's view, ready to be differentiated."""

    sensor: Sensor
    side: Side
    reference: Pinhole | None
    depth_m: Image  # (h, w) z along the imager's axis, NaN where there is nothing.
    body: NDArray[np.uint32]  # (h, w) number from 1, 0 where there is nothing.
    clear: Mask  # (h, w) lit as a whole, of one opaque body, and not met at a grazing angle.
    _light: Light
    _hits: tuple[_Hits, ...]

    @property
    def emitters(self) -> int:
        """How many the projector has."""
        return len(self._light.emissions)

    def linear(self, names: tuple[str, ...] = (), *, emitter: int | None = None) -> Linear:
        """Radiance of the projector's light of 1 W [W m^-2 sr^-1], and its derivatives.

        Args:
            names: of `PARAMETERS`.
            emitter: whose part of the light alone is meant; None is all of it.

        Raises:
            InputError: an unknown name.
        """
        mi, dr = backend.mitsuba(), backend.drjit()
        count = self.depth_m.size
        sums = [dr.zeros(mi.Float, count) for _ in range(1 + len(names))]
        for hits in self._hits:
            steps = _steps(names)
            seen = self._radiance(hits, steps, emitter)
            sums[0] = sums[0] + dr.detach(seen)
            for number, name in enumerate(names, 1):
                sums[number] = sums[number] + _forward(steps.attached[name], seen)
            dr.eval(*sums)
        share = np.float32(1 / len(self._hits))
        images = [total.numpy().reshape(self.depth_m.shape) * share for total in sums]
        return Linear(image=images[0], columns=dict(zip(names, images[1:], strict=True)))

    def pulled(self, names: tuple[str, ...], weights: Image) -> dict[str, float]:
        """Derivative of the weighted sum of the image by each parameter, by backward mode.

        Args:
            names: of `PARAMETERS`.
            weights: (h, w) of the pixels.

        Raises:
            InputError: an unknown name.
        """
        mi, dr = backend.mitsuba(), backend.drjit()
        weight = mi.Float(np.ascontiguousarray(weights, np.float32).ravel())
        total = dict.fromkeys(names, 0.0)
        for hits in self._hits:
            steps = _steps(names)
            dr.backward(dr.sum(self._radiance(hits, steps, None) * weight))
            for name in names:
                total[name] += float(np.array(dr.grad(steps.attached[name])).sum())
        return {name: value / len(self._hits) for name, value in total.items()}

    def flow(self, names: tuple[str, ...]) -> dict[str, NDArray[np.float32]]:
        """How fast the dots move over the image, (h, w, 2) [px] a unit of each parameter.

        A dot stays where its direction leaves the projector: with s(u, p) the tangents that
        pixel u sees, du/dp = -(ds/du)^-1 ds/dp. Of several emitters the first stands for all.
        0 where there is no surface.

        Args:
            names: of `PARAMETERS`.

        Raises:
            InputError: an unknown name.
        """
        dr = backend.drjit()
        asked = tuple(dict.fromkeys((*names, *RAY)))
        steps = _steps(asked)
        hits = self._hits[0]
        rig = self._rig(steps)
        local = rig.local(rig.point(hits.pixel, hits.point, hits.normal), self._light.places[0])
        slopes = rig.tangents(local)
        columns = {
            name: [_forward(steps.attached[name], slope) for slope in slopes] for name in asked
        }
        dr.eval(columns)
        rate = {
            name: np.stack([part.numpy() for part in pair], axis=-1).astype(np.float64)
            for name, pair in columns.items()
        }
        across, down = rate[RAY[0]], rate[RAY[1]]
        area = across[:, 0] * down[:, 1] - across[:, 1] * down[:, 0]
        found = {}
        with np.errstate(invalid="ignore", divide="ignore"):
            for name in names:
                x = -(rate[name][:, 0] * down[:, 1] - rate[name][:, 1] * down[:, 0]) / area
                y = -(rate[name][:, 1] * across[:, 0] - rate[name][:, 0] * across[:, 1]) / area
                both = np.stack([x, y], axis=-1).reshape(*self.depth_m.shape, 2)
                both[~(np.isfinite(both).all(axis=-1) & self.clear)] = 0
                found[name] = both.astype(np.float32)
        return found

    def _rig(self, steps: Steps) -> Rig:
        return Rig.of(
            self.sensor, right=self.side == "right", reference=self.reference, steps=steps
        )

    def _radiance(self, hits: _Hits, steps: Steps, emitter: int | None) -> Any:
        """As `starling.sim.render.beam.Beam.returned`, with the points attached to the parameters."""
        mi, dr = backend.mitsuba(), backend.drjit()
        rig = self._rig(steps)
        point = rig.point(hits.pixel, hits.point, hits.normal)
        spread = dr.square(1 + steps("projector.field"))  # A wider field thins the light.
        toward = dr.normalize(rig.place - point)
        cosine = dr.dot(hits.shading, toward)
        turned = cosine / dr.maximum(dr.detach(cosine), 1e-6)  # 1, with the cosine's derivative.
        total = mi.Float(0)
        for number in range(self.emitters) if emitter is None else (emitter,):
            local = rig.local(point, self._light.places[number])
            lit = hits.lit[number]
            plane = rig.thrown(self._light.emissions[number]).irradiance(local, lit) / spread
            cos_alpha = local.z / dr.norm(local)
            total += dr.select(lit, hits.returned[number] * turned * plane / cos_alpha, 0)
        return total


def _steps(names: tuple[str, ...]) -> Steps:
    for name in names:
        errors.one_of("parameter", name, PARAMETERS)
    return Steps.of(names)


def _forward(step: Any, image: Any) -> Any:
    """Derivative of an image by one step; the graph is kept for the others."""
    dr = backend.drjit()
    dr.clear_grad(image)
    dr.set_grad(step, 1)
    dr.enqueue(dr.ADMode.Forward, step)
    dr.traverse(dr.ADMode.Forward, flags=dr.ADFlag.ClearInterior | dr.ADFlag.ClearInput)
    found = dr.grad(image)
    dr.clear_grad(image)
    return found


def _hits(
    stage: Stage, rig: Rig, light: Light, shift: tuple[float, float]
) -> tuple[_Hits, Image, NDArray[np.uint32], Mask]:
    """Trace one place in every pixel: hits, depth, body numbers, and where derivatives hold."""
    mi, dr = backend.mitsuba(), backend.drjit()
    sensor = rig.sensor
    left = Placed.of(stage.scene.world_from_left)
    pixel = pixels((sensor.width, sensor.height)) + opaque("Vector2f", shift)
    way = rig.direction(pixel)
    start = left.origin + _turned(left, rig.origin)
    si = stage.mitsuba.ray_intersect(mi.Ray3f(start, dr.normalize(_turned(left, way))))
    point, facet = left.local(si.p), _unturned(left, si.n)
    shading = _unturned(left, towards_viewer(si))
    actual = rig.point(pixel, point, facet)
    lit, returned = [], []
    for emission, place in zip(light.emissions, light.places, strict=True):
        source = left.origin + _turned(left, rig.traced(rig.source(place)))
        covered = si.is_valid() & emission.covers(rig.local(actual, place))
        shadow = between(source, si.p, stage.scene.shadow_tolerance)
        reached = stage.passed(shadow, covered) > 0
        toward = si.to_local(dr.normalize(source - si.p))
        returned.append(si.bsdf().eval(mi.BSDFContext(), si, toward, reached)[0])
        lit.append(reached)
    steep = abs(dr.dot(facet, dr.normalize(way))) >= _GRAZING
    plain = reduce(operator.and_, lit) & steep
    handle = dr.reinterpret_array(mi.UInt32, si.shape)
    hits = _Hits(pixel, point, facet, shading, tuple(returned), tuple(lit))
    valid = si.is_valid()
    dr.eval(pixel, point, facet, shading, returned, lit, plain, valid, handle)
    number = np.where(
        valid.numpy(), stage.numbers[np.minimum(handle.numpy(), len(stage.numbers) - 1)], 0
    )
    itself = ~np.isin(number, _showing_others(stage))
    shape = (sensor.height, sensor.width)
    return (
        hits,
        np.where(valid.numpy(), point.z.numpy(), np.float32(np.nan)).reshape(shape),
        number.reshape(shape),
        (plain.numpy() & itself).reshape(shape),
    )


def _turned(left: Placed, vector: Any) -> Any:
    return left.x * vector.x + left.y * vector.y + left.z * vector.z


def _unturned(left: Placed, vector: Any) -> Any:
    mi, dr = backend.mitsuba(), backend.drjit()
    return mi.Vector3f(*(dr.dot(axis, mi.Vector3f(vector)) for axis in (left.x, left.y, left.z)))


def _showing_others(stage: Stage) -> list[int]:
    """Numbers of the bodies that show other places than their own."""
    return [
        number
        for number, body in enumerate(stage.scene.bodies, 1)
        if body.material.kind in _TRANSPARENT
    ]


def _refuse_undifferentiable(stage: Stage, sensor: Sensor) -> None:
    if not backend.is_jit():
        raise backend.BackendError(
            "gradients must be computed in a compiled variant; got scalar_rgb. "
            "Install libllvm19, or an NVIDIA driver."
        )
    if sensor.baseline_error or stage.scene.model_error != ModelError():
        raise errors.refuse(
            "geometry",
            "must be stated whole to be differentiated",
            f"baseline_error {sensor.baseline_error:g} and scene.model_error",
            "Put them into baseline_m and into the scene's pose.",
        )
    if not stage.scene.motion.still:
        raise errors.refuse(
            "scene.motion", "must be still to be differentiated", "a moving sensor", "Stop it."
        )
