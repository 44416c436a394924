"""The rig's geometry with derivatives: from a pixel through the surface into the projector.

All lengths are in the left imager's frame. Each parameter is a small step d, 0 where it stands, so
that one pass of automatic differentiation gives the derivative by any of them.
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
from starling.sim.render.beam import Emission
from starling.sim.render.rays import Placed, opaque
from starling.sim.sensor.sensor import Sensor

AXES = "xyz"
RAY = ("ray.x_px", "ray.y_px")  # Steps of where in the image a pixel looks, +x right, +y down.
_TURN_DEG = 1e-3  # Step of the central difference of a rotation matrix by its vector.


@dataclass(frozen=True, slots=True)
class Steps:
    """Parameters' steps by name: attached where a derivative is asked for, else nothing."""

    attached: Mapping[str, Any]

    @staticmethod
    def of(names: tuple[str, ...]) -> Steps:
        mi, dr = backend.mitsuba(), backend.drjit()
        steps = {name: mi.Float(0) for name in names}
        for step in steps.values():
            dr.enable_grad(step)
        return Steps(steps)

    def __call__(self, name: str) -> Any:
        return self.attached.get(name, 0.0)


@dataclass(frozen=True, slots=True)
class Rig:
    """Imager and projector about their present values."""

    steps: Steps
    sensor: Sensor
    right: bool
    reference: Pinhole | None  # That the surface was made with, where it follows the focal length.
    focal: Any  # Vector2f of the image in which the surface is traced [px]
    centre: Any
    origin: Any  # Vector3f, of the imager
    place: Any  # Vector3f, of the projector
    axes: tuple[Any, Any, Any]  # The projector's x, y, z

    @staticmethod
    def of(sensor: Sensor, *, right: bool, reference: Pinhole | None, steps: Steps) -> Rig:
        """Attach the steps to the rig of a sensor that has no baseline error.

        Args:
            sensor: where the parameters stand.
            right: the right imager, else the left.
            reference: pinhole by which a reference depth map became a surface. Its points move
                sideways as focal length and principal point do; None for a surface known in
                metres, which stays.
            steps: of the parameters.
        """
        mi = backend.mitsuba()
        part, seen = sensor.projector, reference or sensor
        focal, centre = (
            opaque("Vector2f", (seen.fx_px, seen.fy_px)),
            opaque("Vector2f", (seen.cx_px, seen.cy_px)),
        )
        baseline = opaque("Float", [sensor.baseline_m if right else 0.0])
        if right:
            baseline = baseline + steps("baseline_m")
        if reference is None:
            per_px = opaque("Float", [1 / sensor.fx_px])  # fx and fy keep their ratio.
            focal = focal * (1 + steps("fx_px") * per_px)
            centre = mi.Vector2f(centre.x + steps("cx_px"), centre.y + steps("cy_px"))
        else:  # In the reference's own frame a wider focal length is a longer baseline.
            growth = opaque("Float", [sensor.fx_px / reference.fx_px])
            baseline = baseline * (growth + steps("fx_px") / reference.fx_px)
        place = opaque("Vector3f", part.position_m)
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
            axes=_axes(part.rotation_deg, steps),
        )

    def direction(self, pixel: Any) -> Any:
        """Ray through image coordinates, at unit depth, where the surface is traced."""
        mi = backend.mitsuba()
        x, y = pixel.x + self.steps(RAY[0]), pixel.y + self.steps(RAY[1])
        slope = (mi.Vector2f(x, y) - self.centre) / self.focal
        return mi.Vector3f(slope.x, slope.y, 1)

    def point(self, pixel: Any, anchor: Any, normal: Any) -> Any:
        """Surface point that a pixel sees: its ray cut with the plane through a point found.

        Args:
            pixel: image coordinates.
            anchor: the point found on that ray.
            normal: of the facet it lies on.
        """
        mi, dr = backend.mitsuba(), backend.drjit()
        way = self.direction(pixel)
        found = self.origin + way * (dr.dot(normal, anchor - self.origin) / dr.dot(normal, way))
        if self.reference is None:
            return found
        seen, made = self.sensor, self.reference
        growth = opaque("Float", [seen.fx_px / made.fx_px]) + self.steps("fx_px") / made.fx_px
        left = opaque("Float", [(made.cx_px - seen.cx_px) / made.fx_px])
        up = opaque("Float", [(made.cy_px - seen.cy_px) / made.fy_px])
        return mi.Vector3f(
            (found.x + (left - self.steps("cx_px") / made.fx_px) * found.z) / growth,
            (found.y + (up - self.steps("cy_px") / made.fy_px) * found.z) / growth,
            found.z,
        )

    def traced(self, point: Any) -> Any:
        """Point of the left frame in the frame where the surface is traced; undoes `point`."""
        mi = backend.mitsuba()
        if self.reference is None:
            return point
        seen, made = self.sensor, self.reference
        growth = opaque("Float", [seen.fx_px / made.fx_px])
        across = opaque("Float", [(seen.cx_px - made.cx_px) / made.fx_px])
        down = opaque("Float", [(seen.cy_px - made.cy_px) / made.fy_px])
        x, y, z = point.x, point.y, point.z
        return mi.Vector3f(x * growth + across * z, y * growth + down * z, z)

    def local(self, point: Any, emitter: Placed | None) -> Any:
        """Surface point in the frame of an emitter; None is the projector's own."""
        mi, dr = backend.mitsuba(), backend.drjit()
        way = point - self.place
        own = mi.Vector3f(*(dr.dot(axis, way) for axis in self.axes))
        return own if emitter is None else emitter.local(own)

    def source(self, emitter: Placed | None) -> Any:
        """Place of an emitter, without derivatives."""
        dr = backend.drjit()
        if emitter is None:
            return dr.detach(self.place)
        x, y, z = self.axes
        off = emitter.origin
        return dr.detach(self.place + x * off.x + y * off.y + z * off.z)

    def tangents(self, local: Any) -> tuple[Any, Any]:
        """Where in a pattern of fixed scale and field the light to a point of its frame starts."""
        dr = backend.drjit()
        now = opaque("Float", [self.sensor.projector.pattern_scale])
        scale = dr.norm(local) * (now + self.steps("projector.pattern_scale"))
        x, y = local.x / scale, local.y / scale
        wide = dr.sqrt(1 - dr.square(x) - dr.square(y)) * (1 + self.steps("projector.field"))
        return x / wide, y / wide

    def thrown(self, emission: Emission) -> Emission:
        """What an emitter throws, its field and scale attached."""
        field, scale = self.steps("projector.field"), emission.scale
        if "projector.pattern_scale" in self.steps.attached:
            now = opaque("Float", [self.sensor.projector.pattern_scale])
            scale = now + self.steps("projector.pattern_scale")
        return dataclasses.replace(
            emission, half_tangent=emission.half_tangent * (1 + field), scale=scale
        )


def _axes(rotation_deg: tuple[float, float, float], steps: Steps) -> tuple[Any, Any, Any]:
    """Axes of the projector, exact to first order in the steps of its rotation vector [deg]."""
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

    def turned(step: float) -> NDArray[np.float64]:
        vector = list(rotation_deg)
        vector[number] += step
        return frames.rotation((vector[0], vector[1], vector[2]))

    return (turned(_TURN_DEG) - turned(-_TURN_DEG)) / (2 * _TURN_DEG)
