"""The projector's field of view: angles, tangent-plane coordinates and pixels."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from starling.patterns.errors import in_interval, whole_number

SMALLEST_SIDE_PX = 32
LARGEST_SIDE_PX = 8192


@dataclass(frozen=True, slots=True)
class Field:
    """A rectangular field of view, seen as a pinhole image (x right, y down).

    Tangents (x/z, y/z) describe a direction. The centre of pixel (0, 0) lies half a pixel inside
    the corner, so the axis meets pixel ((w - 1) / 2, (h - 1) / 2).

    Args:
        fov_x_deg: Full horizontal field [deg], in [1, 150].
        fov_y_deg: Full vertical field [deg], in [1, 150].

    Raises:
        InputError: if an angle is outside.
    """

    fov_x_deg: float
    fov_y_deg: float

    def __post_init__(self) -> None:
        for name in ("fov_x_deg", "fov_y_deg"):
            value = getattr(self, name)
            in_interval(name, value, 1.0, 150.0, "Give the full field of view in degrees.")

    @property
    def half_x(self) -> float:
        """Tangent of half the horizontal field."""
        return math.tan(math.radians(self.fov_x_deg) / 2)

    @property
    def half_y(self) -> float:
        """Tangent of half the vertical field."""
        return math.tan(math.radians(self.fov_y_deg) / 2)

    @property
    def area_m2(self) -> float:
        """Lit area of the plane at one metre, perpendicular to the axis [m^2]."""
        return 4 * self.half_x * self.half_y

    @property
    def solid_angle_deg2(self) -> float:
        """Solid angle of the field's pyramid [deg^2], where 1 sr = (180/pi)^2 deg^2."""
        x, y = self.half_x, self.half_y
        return 4 * math.atan(x * y / math.sqrt(1 + x * x + y * y)) * math.degrees(1) ** 2

    def shape(self, width_px: int) -> tuple[int, int]:
        """Image shape (h, w) with square pixels at this width.

        Raises:
            InputError: if the width is not an integer, or a side is outside [32, 8192] pixels.
        """
        sides = SMALLEST_SIDE_PX, LARGEST_SIDE_PX
        width = whole_number("width_px", width_px, *sides, "Give the image width in whole pixels.")
        height = round(width * self.half_y / self.half_x)
        return whole_number("image height", height, *sides, "Change width_px."), width

    def focal_px(self, shape: tuple[int, int]) -> tuple[float, float]:
        """Focal lengths (fx, fy) [px] of an image of this shape (h, w) over the field."""
        return shape[1] / (2 * self.half_x), shape[0] / (2 * self.half_y)

    def pixels(
        self, x: np.ndarray, y: np.ndarray, shape: tuple[int, int]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Pixel positions (x, y) of tangents (x, y), each (n,), in an image of shape (h, w)."""
        focal_x, focal_y = self.focal_px(shape)
        return x * focal_x + (shape[1] - 1) / 2, y * focal_y + (shape[0] - 1) / 2

    def tangents(
        self, x_px: np.ndarray, y_px: np.ndarray, shape: tuple[int, int]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Tangents (x, y) of pixel positions: the inverse of `pixels`."""
        focal_x, focal_y = self.focal_px(shape)
        return (x_px - (shape[1] - 1) / 2) / focal_x, (y_px - (shape[0] - 1) / 2) / focal_y

    def holds(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Whether each tangent lies inside the field, (n,) bool."""
        return (np.abs(x) < self.half_x) & (np.abs(y) < self.half_y)

    def uniform_directions(self, n: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Draw `n` directions uniform over the solid angle, as tangents (x, y), each (n,)."""
        x, y = np.empty(0), np.empty(0)
        while len(x) < n:
            u = rng.random((3, 2 * (n - len(x)) + 64))
            candidate_x = (2 * u[0] - 1) * self.half_x
            candidate_y = (2 * u[1] - 1) * self.half_y
            # A plane element at tangent r subtends (1 + r^2)^-1.5 of its area.
            keep = u[2] < (1 + candidate_x**2 + candidate_y**2) ** -1.5
            x = np.concatenate([x, candidate_x[keep]])
            y = np.concatenate([y, candidate_y[keep]])
        return x[:n], y[:n]


def unit_vectors(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Unit vectors (n, 3) of tangents; for small angles their chords are angles [rad]."""
    rays = np.stack([x, y, np.ones_like(x)], axis=-1)
    return rays / np.linalg.norm(rays, axis=-1, keepdims=True)


def directions_from_cosines(a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Convert direction cosines (a, b) to tangents (x, y); those beyond 88 deg are dropped.

    The orders of a diffractive element are evenly spaced in direction cosines (grating
    equation). On a plane this spacing looks like a pincushion distortion.
    """
    rest = 1 - a * a - b * b
    keep = rest > 1e-3
    z = np.sqrt(rest[keep])
    return a[keep] / z, b[keep] / z
