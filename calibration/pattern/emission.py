"""Direction cosines of surface points from an emitter, and their derivatives.

The cosines (a, b) refer to the projector's axes. The dots of a diffractive element are regular in
them. A relative change of the laser's wavelength scales them about the axis.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from starling.calibration.observation import Side
from starling.sim.geometry import frames

Array = NDArray[np.floating[Any]]

# Names of the parameters of the derivatives below, in order.
PLACE = ("x", "y", "z")
TURN = ("pitch", "yaw")
RIGHT = ("offset_y", "roll", "offset_x", "focal_baseline")


@dataclass(frozen=True, kw_only=True, slots=True)
class RightAlignment:
    """Shift of the right image against its nominal rays."""

    offset_y: float = 0.0  # Downward shift [px].
    roll: float = 0.0  # Clockwise rotation, as the shift at a tangent of 1 [px].
    offset_x: float = 0.0  # Shift to the right [px].
    focal_baseline: float = 0.0  # Nominal minus true f * b: shift to the right at 1 m [px m].

    def as_vector(self) -> NDArray[np.float64]:
        """Return the four values in the order of `RIGHT`."""
        return np.array([self.offset_y, self.roll, self.offset_x, self.focal_baseline])

    @staticmethod
    def from_vector(values: NDArray[np.float64]) -> RightAlignment:
        """Invert `as_vector`."""
        offset_y, roll, offset_x, focal_baseline = map(float, values)
        return RightAlignment(
            offset_y=offset_y, roll=roll, offset_x=offset_x, focal_baseline=focal_baseline
        )


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class SurfacePoints:
    """Surface points of n pixels of one view."""

    points_m: Array  # (n, 3) in the left frame.
    slopes: Array  # (n, 2) tangents of the imager's rays.
    side: Side
    focal_px: float

    def shifted(self, alignment: RightAlignment) -> Array:
        """Return the points (n, 3) that the pixels show with a misaligned right image."""
        if self.side == "left":
            return self.points_m
        x, y = self.slopes.T
        depth = self.points_m[:, 2]
        shift_x = alignment.offset_x - alignment.roll * y + alignment.focal_baseline / depth
        shift_y = alignment.offset_y + alignment.roll * x
        points_m = self.points_m.copy()
        points_m[:, 0] -= shift_x * depth / self.focal_px
        points_m[:, 1] -= shift_y * depth / self.focal_px
        return points_m


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Directions:
    """Directions of points from an emitter."""

    cosines: Array  # (n, 2) nominal cosines, divided by the scene's scale.
    unit: Array  # (n, 3) unit vectors in the projector's axes.
    range_m: Array  # (n,) distances.
    scale: float
    axes: NDArray[np.float64]  # (3, 3) columns: the projector's axes in the left frame.


def directions(
    points_m: Array,
    *,
    position_m: NDArray[np.float64],
    rotation_deg: tuple[float, float, float],
    scale: float,
) -> Directions:
    """Compute direction cosines of points from an emitter.

    Args:
        points_m: (n, 3) in the left frame.
        position_m: (3,) position of the emitter in the left frame.
        rotation_deg: rotation of the projector (see `starling.sim.geometry.frames.rotation`).
        scale: pattern scale of the scene; it divides the cosines.
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


def place_partials(rays: Directions) -> Array:
    """Return derivatives (3, n, 2) of the cosines by the emitter's position, left frame [1/m]."""
    # d unit / d local = (1 - u u') / range; d local / d position = -1 in the projector's axes.
    u = rays.unit
    local = -(np.eye(3, dtype=np.float32)[None, :, :2] - u[:, :, None] * u[:, None, :2])
    local /= (rays.range_m * rays.scale)[:, None, None]
    return np.tensordot(rays.axes.astype(np.float32), local, axes=(1, 1))


def turn_partials(rays: Directions) -> Array:
    """Return derivatives (2, n, 2) by rotations about the projector's x and y axes [1/rad].

    A rotation vector w adds -w x u to a direction u in the rotated axes.
    """
    zero = np.zeros_like(rays.range_m)
    forward = rays.unit[:, 2] / np.float32(rays.scale)
    return np.stack([np.stack([zero, forward], axis=1), np.stack([-forward, zero], axis=1)])


def scale_partial(rays: Directions) -> Array:
    """Return the derivative (n, 2) by the scene's pattern scale."""
    return -rays.cosines / np.float32(rays.scale)


def right_partials(points: SurfacePoints, rays: Directions) -> Array:
    """Return derivatives (4, n, 2) by the right image's alignment [1/px]; 0 for the left image."""
    partials = np.zeros((4, len(points.points_m), 2), np.float32)
    if points.side == "left":
        return partials
    dx, dy, _ = -place_partials(
        rays
    )  # A shift of the point equals the opposite shift of the emitter.
    depth = points.points_m[:, 2:3]
    pixel = depth / np.float32(points.focal_px)
    x, y = points.slopes[:, :1], points.slopes[:, 1:]
    partials[0] = -dy * pixel
    partials[1] = (dx * y - dy * x) * pixel
    partials[2] = -dx * pixel
    partials[3] = -dx * pixel / depth
    return partials
