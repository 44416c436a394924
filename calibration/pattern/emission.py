"""In which direction from an emitter surface points lie, and how that moves with its place.

Directions are cosines (a, b) about the projector's axes: a diffractive element lays its dots evenly
in them, and a laser whose wavelength drifts by a share scales them by it about the axis.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from starling.sim.geometry import frames

Array = NDArray[np.floating[Any]]

PLACE = ("x", "y", "z")  # Names of what `partials` are with respect to, in their order.
TURN = ("pitch", "yaw")
RIGHT = ("offset_y", "roll", "offset_x", "focal_baseline")


@dataclass(frozen=True, kw_only=True, slots=True)
class Alignment:
    """How the right image lies off where its pixels' rays say, in pixels."""

    offset_y: float = 0.0  # Down [px].
    roll: float = 0.0  # Clockwise: shift at a tangent of 1 [px].
    offset_x: float = 0.0  # To the right [px].
    focal_baseline: float = 0.0  # To the right, of a point at 1 m [px m]: less f b than believed.

    def as_vector(self) -> NDArray[np.float64]:
        """The four values in the order of `RIGHT`."""
        return np.array([self.offset_y, self.roll, self.offset_x, self.focal_baseline])

    @staticmethod
    def of(values: NDArray[np.float64]) -> Alignment:
        """The inverse of `as_vector`."""
        offset_y, roll, offset_x, focal_baseline = map(float, values)
        return Alignment(
            offset_y=offset_y, roll=roll, offset_x=offset_x, focal_baseline=focal_baseline
        )


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Seen:
    """Surface points of some pixels of one view, flat."""

    points_m: Array  # (n, 3) left frame.
    slopes: Array  # (n, 2) tangents of the imager's rays.
    side: Literal["left", "right"]
    focal_px: float

    def moved(self, alignment: Alignment) -> Array:
        """Points (n, 3) that the pixels really show where the right image is off."""
        if self.side == "left":
            return self.points_m
        x, y = self.slopes.T
        depth = self.points_m[:, 2]
        shift_x = alignment.offset_x - alignment.roll * y + alignment.focal_baseline / depth
        shift_y = alignment.offset_y + alignment.roll * x
        moved = self.points_m.copy()
        moved[:, 0] -= shift_x * depth / self.focal_px
        moved[:, 1] -= shift_y * depth / self.focal_px
        return moved


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Directions:
    """Where points lie from an emitter."""

    cosines: Array  # (n, 2) nominal: over the scene's scale.
    unit: Array  # (n, 3) in the projector's axes.
    range_m: Array  # (n,)
    scale: float
    axes: NDArray[np.float64]  # (3, 3) columns: the projector's axes in the left frame.


def directions(
    points_m: Array,
    *,
    position_m: NDArray[np.float64],
    rotation_deg: tuple[float, float, float],
    scale: float,
) -> Directions:
    """Direction cosines of points from an emitter.

    Args:
        points_m: (n, 3) in the left frame.
        position_m: (3,) of the emitter, left frame.
        rotation_deg: of the projector's axes (see `starling.sim.geometry.frames.rotation`).
        scale: pattern scale of the scene; cosines are over it.
    """
    axes = frames.rotation(rotation_deg)
    offset = points_m - position_m.astype(np.float32)
    local = offset @ axes.astype(np.float32)
    distance = np.linalg.norm(local, axis=1)
    unit = local / distance[:, None]
    return Directions(
        cosines=unit[:, :2] / np.float32(scale),
        unit=unit,
        range_m=distance,
        scale=scale,
        axes=axes,
    )


def place_partials(there: Directions) -> Array:
    """Derivatives (3, n, 2) of the cosines by the emitter's position in the left frame [1/m]."""
    # d unit / d local = (1 - u u') / range, and local moves against the emitter, in its own axes.
    u = there.unit
    local = -(np.eye(3, dtype=np.float32)[None, :, :2] - u[:, :, None] * u[:, None, :2])
    local /= (there.range_m * there.scale)[:, None, None]
    return np.tensordot(there.axes.astype(np.float32), local, axes=(1, 1))


def turn_partials(there: Directions) -> Array:
    """Derivatives (2, n, 2) by turns about the projector's own x and y axes [1/rad].

    A turn by the rotation vector w adds -w x u to a direction seen from the turned axes.
    """
    zero = np.zeros_like(there.range_m)
    forward = there.unit[:, 2] / np.float32(there.scale)
    return np.stack([np.stack([zero, forward], axis=1), np.stack([-forward, zero], axis=1)])


def scale_partial(there: Directions) -> Array:
    """Derivative (n, 2) by the scene's pattern scale."""
    return -there.cosines / np.float32(there.scale)


def right_partials(seen: Seen, there: Directions) -> Array:
    """Derivatives (4, n, 2) by the right image's alignment [1/px]; zeros for the left image."""
    out = np.zeros((4, len(seen.points_m), 2), np.float32)
    if seen.side == "left":
        return out
    across, down, _ = -place_partials(there)  # Moving the point is moving the emitter back.
    depth = seen.points_m[:, 2:3]
    pixel = depth / np.float32(seen.focal_px)
    x, y = seen.slopes[:, :1], seen.slopes[:, 1:]
    out[0] = -down * pixel
    out[1] = (across * y - down * x) * pixel
    out[2] = -across * pixel
    out[3] = -across * pixel / depth
    return out
