"""Differentiable geometry of the rig: from a pixel over the surface into the projector.

All quantities are in the left imager's frame. Each parameter is a step from its present value, so
that automatic differentiation at 0 gives the derivatives.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from starling.sim.geometry import frames
from starling.sim.geometry.pinhole import Pinhole
from starling.sim.render import backend
from starling.sim.render.beam import EmittedPattern
from starling.sim.render.rays import JitPose, opaque
from starling.sim.sensor.sensor import Sensor

AXES = "xyz"
RAY = ("ray.x_px", "ray.y_px")  # Steps of a pixel's image position, +x right, +y down.
_TURN_DEG = 1e-3  # Step of central differences of a rotation matrix [deg].


@dataclass(frozen=True, slots=True)
class Steps:
    """Steps of the parameters by name: 0, attached to the graph if differentiated."""

    attached: Mapping[str, Any]

    @staticmethod
    def attach(names: tuple[str, ...]) -> Steps:
        mi, dr = backend.mitsuba(), backend.drjit()
        steps = {name: mi.Float(0) for name in names}
        for step in steps.values():
            dr.enable_grad(step)
        return Steps(steps)

    def __call__(self, name: str) -> Any:
        return self.attached.get(name, 0.0)


@dataclass(frozen=True, slots=True)
class Rig:
    """Imager and projector as functions of the parameters' steps."""

    steps: Steps
    sensor: Sensor
    right: bool
    reference: Pinhole | None  # Pinhole of the reference depth, if the surface depends on it.
    focal: Any  # Vector2f, of the image in which the surface is traced [px]
    centre: Any
    origin: Any  # Vector3f, position of the imager
    place: Any  # Vector3f, position of the projector
    axes: tuple[Any, Any, Any]  # The projector's x, y, z

    @staticmethod
    def from_sensor(sensor: Sensor, *, right: bool, reference: Pinhole | None, steps: Steps) -> Rig:
        """Build the rig of a sensor without baseline error.

        Args:
            sensor: Present values of the parameters.
            right: Right imager, else left.
            reference: Pinhole that converted a reference depth map to the surface, whose points
                move sideways with focal length and principal point. None for a surface known in
                metres, which is fixed.
            steps: Steps of the parameters.
        """
        mi = backend.mitsuba()
        projector, camera = sensor.projector, reference or sensor
        focal, centre = (
            opaque("Vector2f", (camera.fx_px, camera.fy_px)),
            opaque("Vector2f", (camera.cx_px, camera.cy_px)),
        )
        baseline = opaque("Float", [sensor.baseline_m if right else 0.0])
        if right:
            baseline = baseline + steps("baseline_m")
        if reference is None:
            per_px = opaque("Float", [1 / sensor.fx_px])  # fx and fy keep their ratio.
            focal = focal * (1 + steps("fx_px") * per_px)
            centre = mi.Vector2f(centre.x + steps("cx_px"), centre.y + steps("cy_px"))
        else:  # In the reference's frame a longer focal length acts as a longer baseline.
            growth = opaque("Float", [sensor.fx_px / reference.fx_px])
            baseline = baseline * (growth + steps("fx_px") / reference.fx_px)
        place = opaque("Vector3f", projector.position_m)
        moved = [place[i] + steps(f"projector.position_m.{AXES[i]}") for i in range(3)]
        return Rig(
            steps=steps,
            sensor=sensor,
            right=right,
            reference=reference,
            focal=focal,
            centre=centre,
            origin=mi.Vector3f(baseline, 0, 0),
            place=mi.Vector3f(*moved),
            axes=_axes(projector.rotation_deg, steps),
        )

    def direction(self, pixel: Any) -> Any:
        """Ray direction of image coordinates, at unit depth, in the traced frame."""
        mi = backend.mitsuba()
        x, y = pixel.x + self.steps(RAY[0]), pixel.y + self.steps(RAY[1])
        slope = (mi.Vector2f(x, y) - self.centre) / self.focal
        return mi.Vector3f(slope.x, slope.y, 1)

    def point(self, pixel: Any, anchor: Any, normal: Any) -> Any:
        """Surface point of a pixel: intersection of its ray with the facet's plane.

        Args:
            pixel: Image coordinates.
            anchor: Traced point on that ray.
            normal: Normal of its facet.
        """
        mi, dr = backend.mitsuba(), backend.drjit()
        ray = self.direction(pixel)
        hit = self.origin + ray * (dr.dot(normal, anchor - self.origin) / dr.dot(normal, ray))
        if self.reference is None:
            return hit
        now, ref = self.sensor, self.reference
        growth = opaque("Float", [now.fx_px / ref.fx_px]) + self.steps("fx_px") / ref.fx_px
        across = opaque("Float", [(ref.cx_px - now.cx_px) / ref.fx_px])
        down = opaque("Float", [(ref.cy_px - now.cy_px) / ref.fy_px])
        return mi.Vector3f(
            (hit.x + (across - self.steps("cx_px") / ref.fx_px) * hit.z) / growth,
            (hit.y + (down - self.steps("cy_px") / ref.fy_px) * hit.z) / growth,
            hit.z,
        )

    def traced(self, point: Any) -> Any:
        """Transform a point from the left frame to the traced frame; inverse of `point`."""
        mi = backend.mitsuba()
        if self.reference is None:
            return point
        now, ref = self.sensor, self.reference
        growth = opaque("Float", [now.fx_px / ref.fx_px])
        across = opaque("Float", [(now.cx_px - ref.cx_px) / ref.fx_px])
        down = opaque("Float", [(now.cy_px - ref.cy_px) / ref.fy_px])
        x, y, z = point.x, point.y, point.z
        return mi.Vector3f(x * growth + across * z, y * growth + down * z, z)

    def local(self, point: Any, emitter: JitPose | None) -> Any:
        """Transform a surface point to the frame of an emitter; None is the projector's frame."""
        mi, dr = backend.mitsuba(), backend.drjit()
        offset = point - self.place
        local = mi.Vector3f(*(dr.dot(axis, offset) for axis in self.axes))
        return local if emitter is None else emitter.local(local)

    def source(self, emitter: JitPose | None) -> Any:
        """Position of an emitter, without derivatives."""
        dr = backend.drjit()
        if emitter is None:
            return dr.detach(self.place)
        x, y, z = self.axes
        off = emitter.origin
        return dr.detach(self.place + x * off.x + y * off.y + z * off.z)

    def tangents(self, local: Any) -> tuple[Any, Any]:
        """Tangents in the nominal pattern of the light that reaches a point."""
        dr = backend.drjit()
        now = opaque("Float", [self.sensor.projector.pattern_scale])
        scale = dr.norm(local) * (now + self.steps("projector.pattern_scale"))
        x, y = local.x / scale, local.y / scale
        wide = dr.sqrt(1 - dr.square(x) - dr.square(y)) * (1 + self.steps("projector.field"))
        return x / wide, y / wide

    def attach_pattern(self, emission: EmittedPattern) -> EmittedPattern:
        """Return an emitter's pattern with field and scale attached to the steps."""
        field, scale = self.steps("projector.field"), emission.scale
        if "projector.pattern_scale" in self.steps.attached:
            now = opaque("Float", [self.sensor.projector.pattern_scale])
            scale = now + self.steps("projector.pattern_scale")
        return dataclasses.replace(
            emission, half_tangent=emission.half_tangent * (1 + field), scale=scale
        )


def _axes(rotation_deg: tuple[float, float, float], steps: Steps) -> tuple[Any, Any, Any]:
    """Axes of the projector, to first order in the steps of its rotation vector [deg]."""
    matrix = frames.rotation(rotation_deg)
    columns = [opaque("Vector3f", matrix[:, i]) for i in range(3)]
    for number, axis in enumerate(AXES):
        name = f"projector.rotation_deg.{axis}"
        if name not in steps.attached:
            continue
        slope = _rotation_slope(rotation_deg, number)
        columns = [
            column + opaque("Vector3f", slope[:, i]) * steps(name)
            for i, column in enumerate(columns)
        ]
    return columns[0], columns[1], columns[2]


def _rotation_slope(rotation_deg: tuple[float, float, float], number: int) -> NDArray[np.float64]:
    """Derivative (3, 3) of a rotation matrix by a component of its vector [1 / deg]."""

    def rotation(step: float) -> NDArray[np.float64]:
        vector = list(rotation_deg)
        vector[number] += step
        return frames.rotation((vector[0], vector[1], vector[2]))

    return (rotation(_TURN_DEG) - rotation(-_TURN_DEG)) / (2 * _TURN_DEG)
