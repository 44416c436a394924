"""The projector's light in one imager, and its derivatives by the rig's geometry.

Rays find the surface. Each ray is then intersected with its facet's plane as a function of the
parameters. Derivatives so propagate from the pixel over the surface into the pattern. The
facet, the shadows and the reflectance are held fixed. The derivatives are therefore invalid at
depth edges and shadow edges, which `TracedView.clear` excludes. They ignore moving texture.

There are few parameters and many pixels, so forward mode computes one column per parameter, all in
one kernel.

Source: forward mode on one graph: Jakob et al., "Dr.Jit", ACM TOG 41(4), 2022.
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
from starling.sim.arrays import Image, Mask
from starling.sim.differentiable.rig import AXES, RAY, Rig, Steps
from starling.sim.geometry.motion import moments
from starling.sim.geometry.pinhole import Pinhole
from starling.sim.render import backend
from starling.sim.render.beam import ProjectorLight, shadow_ray
from starling.sim.render.lights import towards_viewer
from starling.sim.render.mitsuba_scene import MitsubaScene
from starling.sim.render.rays import JitPose, opaque, pixels
from starling.sim.scene.scene import ModelError
from starling.sim.sensor.sensor import Imager, Sensor

Side = Literal["left", "right"]

PARAMETERS = (
    "fx_px",  # fy_px changes in proportion.
    "cx_px",
    "cy_px",
    "baseline_m",
    *(f"projector.position_m.{axis}" for axis in AXES),
    *(f"projector.rotation_deg.{axis}" for axis in AXES),
    "projector.field",  # Relative change of the tangents of both half fields.
    "projector.pattern_scale",
    *RAY,
)
_GRAZING = 0.1  # Least cosine of incidence; below it the facet's plane is a bad approximation.
_TRANSPARENT = ("mirror", "glass")  # Materials that show other surfaces.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Linearised:
    """An image and its derivatives."""

    image: Image  # (h, w)
    columns: Mapping[str, Image]  # Derivative by each parameter, (h, w).


@dataclass(frozen=True, slots=True)
class _Hits:
    """Surface points of the rays at one sub-pixel position."""

    pixel: Any  # Vector2f
    point: Any  # Vector3f in the left frame
    normal: Any  # Vector3f, facet normal
    shading: Any  # Vector3f, shading normal
    brdf_cosine: tuple[Any, ...]  # Float per emitter: BRDF times cosine of its light [1 / sr]
    lit: tuple[Any, ...]  # Bool per emitter


def trace(
    mi_scene: MitsubaScene,
    sensor: Sensor,
    side: Side,
    *,
    subpixels: int = 2,
    reference: Pinhole | None = None,
) -> TracedView:
    """Find the surfaces that one imager sees, and whether the projector lights them.

    Args:
        mi_scene: Scene in Mitsuba, at rest and without model error.
        sensor: Geometry and projector. The alignment of its imagers is ignored here; it acts on
            the rendered image (see `starling.sim.imaging.optics.alignment`).
        side: Imager.
        subpixels: n of the n x n fixed positions in a pixel.
        reference: Pinhole that converted a reference depth map to the scene's surface. Surface
            points then keep their left pixel and move sideways with focal length and principal
            point. None for a surface known in metres.

    Raises:
        BackendError: in a variant that cannot differentiate.
        InputError: if scene or sensor has an additional error of the geometry.
    """
    _refuse_undifferentiable(mi_scene, sensor)
    rig = Rig.from_sensor(sensor, right=side == "right", reference=reference, steps=Steps({}))
    light = ProjectorLight.from_sensor(sensor, mi_scene.scene.world_from_left)
    shifts = [(x, y) for x, y, _ in moments(subpixels, None)]
    hits, clear = [], np.ones((sensor.height, sensor.width), bool)
    depth = body = None
    for shift in shifts:
        hit, hit_depth, hit_body, plain = _hits(mi_scene, rig, light, shift)
        hits.append(hit)
        depth = hit_depth if depth is None else depth
        body = hit_body if body is None else body
        clear &= plain & (hit_body == body)
    assert depth is not None and body is not None  # Each pixel has at least one position.
    return TracedView(
        sensor=sensor,
        side=side,
        reference=reference,
        depth_m=depth,
        body=body,
        clear=clear,
        _light=light,
        _hits=tuple(hits),
    )


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class TracedView:
    """Traced view of one imager, from which derivatives are computed."""

    sensor: Sensor
    side: Side
    reference: Pinhole | None
    depth_m: Image  # (h, w) z along the imager's axis, NaN without surface.
    body: NDArray[np.uint32]  # (h, w) number from 1, 0 without surface.
    clear: Mask  # (h, w) pixels fully lit, on one opaque body, not at a grazing angle.
    _light: ProjectorLight
    _hits: tuple[_Hits, ...]

    @property
    def imager(self) -> Imager:
        """The traced imager."""
        return self.sensor.left if self.side == "left" else self.sensor.right

    @property
    def emitters(self) -> int:
        """Number of the projector's emitters."""
        return len(self._light.emissions)

    def linear(self, names: tuple[str, ...] = (), *, emitter: int | None = None) -> Linearised:
        """Radiance of the projector's light of 1 W [W m^-2 sr^-1], and its derivatives.

        Args:
            names: Parameters in `PARAMETERS`.
            emitter: Number of the only emitter to include; None includes all.

        Raises:
            InputError: for an unknown name.
        """
        mi, dr = backend.mitsuba(), backend.drjit()
        count = self.depth_m.size
        sums = [dr.zeros(mi.Float, count) for _ in range(1 + len(names))]
        for hits in self._hits:
            steps = _steps(names)
            radiance = self._radiance(hits, steps, emitter)
            sums[0] = sums[0] + dr.detach(radiance)
            for number, name in enumerate(names, 1):
                sums[number] = sums[number] + _forward(steps.attached[name], radiance)
            dr.eval(*sums)
        share = np.float32(1 / len(self._hits))
        images = [total.numpy().reshape(self.depth_m.shape) * share for total in sums]
        return Linearised(image=images[0], columns=dict(zip(names, images[1:], strict=True)))

    def flow(self, names: tuple[str, ...]) -> dict[str, NDArray[np.float32]]:
        """Motion of the dots in the image per unit of each parameter, (h, w, 2) [px].

        A dot has a fixed direction in the projector. If pixel u sees the projector tangents
        s(u, p), then du/dp = -(ds/du)^-1 ds/dp. The first emitter represents all. The motion is 0
        outside `clear`.

        Args:
            names: Parameters in `PARAMETERS`.

        Raises:
            InputError: for an unknown name.
        """
        dr = backend.drjit()
        all_names = tuple(dict.fromkeys((*names, *RAY)))
        steps = _steps(all_names)
        hits = self._hits[0]
        rig = self._rig(steps)
        local = rig.local(rig.point(hits.pixel, hits.point, hits.normal), self._light.places[0])
        slopes = rig.tangents(local)
        columns = {
            name: [_forward(steps.attached[name], slope) for slope in slopes] for name in all_names
        }
        dr.eval(columns)
        rate = {
            name: np.stack([part.numpy() for part in pair], axis=-1).astype(np.float64)
            for name, pair in columns.items()
        }
        across, down = rate[RAY[0]], rate[RAY[1]]
        area = across[:, 0] * down[:, 1] - across[:, 1] * down[:, 0]
        flows = {}
        with np.errstate(invalid="ignore", divide="ignore"):
            for name in names:
                x = -(rate[name][:, 0] * down[:, 1] - rate[name][:, 1] * down[:, 0]) / area
                y = -(rate[name][:, 1] * across[:, 0] - rate[name][:, 0] * across[:, 1]) / area
                both = np.stack([x, y], axis=-1).reshape(*self.depth_m.shape, 2)
                both[~(np.isfinite(both).all(axis=-1) & self.clear)] = 0
                flows[name] = both.astype(np.float32)
        return flows

    def _rig(self, steps: Steps) -> Rig:
        return Rig.from_sensor(
            self.sensor, right=self.side == "right", reference=self.reference, steps=steps
        )

    def _radiance(self, hits: _Hits, steps: Steps, emitter: int | None) -> Any:
        """As `starling.sim.render.beam.Beam.reflected`, as a function of the parameters."""
        mi, dr = backend.mitsuba(), backend.drjit()
        rig = self._rig(steps)
        point = rig.point(hits.pixel, hits.point, hits.normal)
        spread = dr.square(1 + steps("projector.field"))  # A wider field reduces the irradiance.
        toward = dr.normalize(rig.place - point)
        cosine = dr.dot(hits.shading, toward)
        turned = cosine / dr.maximum(
            dr.detach(cosine), 1e-6
        )  # Value 1, with the cosine's derivative.
        total = mi.Float(0)
        for number in range(self.emitters) if emitter is None else (emitter,):
            local = rig.local(point, self._light.places[number])
            lit = hits.lit[number]
            plane = (
                rig.attach_pattern(self._light.emissions[number]).irradiance(local, lit) / spread
            )
            cos_alpha = local.z / dr.norm(local)
            total += dr.select(lit, hits.brdf_cosine[number] * turned * plane / cos_alpha, 0)
        return total


def _steps(names: tuple[str, ...]) -> Steps:
    for name in names:
        errors.one_of("parameter", name, PARAMETERS)
    return Steps.attach(names)


def _forward(step: Any, image: Any) -> Any:
    """Derivative of an image by one step; the graph is kept for the next steps."""
    dr = backend.drjit()
    dr.clear_grad(image)
    dr.set_grad(step, 1)
    dr.enqueue(dr.ADMode.Forward, step)
    dr.traverse(dr.ADMode.Forward, flags=dr.ADFlag.ClearInterior | dr.ADFlag.ClearInput)
    derivative = dr.grad(image)
    dr.clear_grad(image)
    return derivative


def _hits(
    mi_scene: MitsubaScene, rig: Rig, light: ProjectorLight, shift: tuple[float, float]
) -> tuple[_Hits, Image, NDArray[np.uint32], Mask]:
    """Trace one sub-pixel position: hits, depth, body numbers, and validity of derivatives."""
    mi, dr = backend.mitsuba(), backend.drjit()
    sensor = rig.sensor
    left = JitPose.from_pose(mi_scene.scene.world_from_left)
    pixel = pixels((sensor.width, sensor.height)) + opaque("Vector2f", shift)
    direction = rig.direction(pixel)
    start = left.origin + _to_world(left, rig.origin)
    si = mi_scene.mitsuba.ray_intersect(mi.Ray3f(start, dr.normalize(_to_world(left, direction))))
    point, facet = left.local(si.p), _to_left(left, si.n)
    shading = _to_left(left, towards_viewer(si))
    actual = rig.point(pixel, point, facet)
    lit, brdf_cosine = [], []
    for emission, place in zip(light.emissions, light.places, strict=True):
        source = left.origin + _to_world(left, rig.traced(rig.source(place)))
        covered = si.is_valid() & emission.covers(rig.local(actual, place))
        shadow = shadow_ray(source, si.p, mi_scene.scene.shadow_tolerance)
        reached = mi_scene.transmittance(shadow, covered) > 0
        toward = si.to_local(dr.normalize(source - si.p))
        brdf_cosine.append(si.bsdf().eval(mi.BSDFContext(), si, toward, reached)[0])
        lit.append(reached)
    steep = abs(dr.dot(facet, dr.normalize(direction))) >= _GRAZING
    plain = reduce(operator.and_, lit) & steep
    handle = dr.reinterpret_array(mi.UInt32, si.shape)
    hits = _Hits(pixel, point, facet, shading, tuple(brdf_cosine), tuple(lit))
    valid = si.is_valid()
    dr.eval(pixel, point, facet, shading, brdf_cosine, lit, plain, valid, handle)
    number = mi_scene.body_numbers(handle.numpy(), valid.numpy())
    direct = ~np.isin(number, _transparent_bodies(mi_scene))
    shape = (sensor.height, sensor.width)
    return (
        hits,
        np.where(valid.numpy(), point.z.numpy(), np.float32(np.nan)).reshape(shape),
        number.reshape(shape),
        (plain.numpy() & direct).reshape(shape),
    )


def _to_world(left: JitPose, vector: Any) -> Any:
    return left.x * vector.x + left.y * vector.y + left.z * vector.z


def _to_left(left: JitPose, vector: Any) -> Any:
    mi, dr = backend.mitsuba(), backend.drjit()
    return mi.Vector3f(*(dr.dot(axis, mi.Vector3f(vector)) for axis in (left.x, left.y, left.z)))


def _transparent_bodies(mi_scene: MitsubaScene) -> list[int]:
    """Numbers of the bodies that show other surfaces."""
    return [
        number
        for number, body in enumerate(mi_scene.scene.bodies, 1)
        if body.material.kind in _TRANSPARENT
    ]


def _refuse_undifferentiable(mi_scene: MitsubaScene, sensor: Sensor) -> None:
    if not backend.is_jit():
        raise backend.BackendError(
            "gradients must be computed in a compiled variant; got scalar_rgb. "
            "Install libllvm19, or an NVIDIA driver."
        )
    if sensor.baseline_error or mi_scene.scene.model_error != ModelError():
        raise errors.refuse(
            "geometry",
            "must be stated whole to be differentiated",
            f"baseline_error {sensor.baseline_error:g} and scene.model_error",
            "Put them into baseline_m and into the scene's pose.",
        )
    if not mi_scene.scene.motion.still:
        raise errors.refuse(
            "scene.motion", "must be still to be differentiated", "a moving sensor", "Stop it."
        )
