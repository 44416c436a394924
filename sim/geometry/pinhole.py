"""Pinhole camera: image size and intrinsics."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from starling.sim import quantities
from starling.sim.arrays import Image


@dataclass(frozen=True, kw_only=True, slots=True)
class Pinhole:
    """Image size and intrinsics of a camera, or of both imagers of a rectified pair."""

    width: int  # [px]
    height: int  # [px]
    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float

    def __post_init__(self) -> None:
        for name in ("width", "height"):
            quantities.check(name, getattr(self, name), "image_side_px")
        for name in ("fx_px", "fy_px"):
            quantities.check_focal(name, getattr(self, name), self.width)
        for name in ("cx_px", "cy_px"):
            quantities.check(name, getattr(self, name), "principal_point_px")

    @classmethod
    def from_camera(cls, camera: Any) -> Pinhole:
        """Copy the fields of a sensor, capture information or colour camera."""
        return cls(**{field.name: getattr(camera, field.name) for field in dataclasses.fields(cls)})

    @classmethod
    def from_matrix(cls, matrix: NDArray[np.floating], size: tuple[int, int]) -> Pinhole:
        """Take a camera matrix (3, 3), or projection (3, 4), of images of (width, height) [px]."""
        fx, fy = float(matrix[0, 0]), float(matrix[1, 1])
        cx, cy = float(matrix[0, 2]), float(matrix[1, 2])
        return cls(width=size[0], height=size[1], fx_px=fx, fy_px=fy, cx_px=cx, cy_px=cy)

    def resized(self, width: int, height: int) -> Pinhole:
        """Return the camera of an image of the same field with another number of pixels."""
        across, down = width / self.width, height / self.height
        return Pinhole(
            width=width,
            height=height,
            fx_px=self.fx_px * across,
            fy_px=self.fy_px * down,
            cx_px=(self.cx_px + 0.5) * across - 0.5,
            cy_px=(self.cy_px + 0.5) * down - 0.5,
        )

    @property
    def matrix(self) -> NDArray[np.float64]:
        """Camera matrix (3, 3) [px]."""
        rows = [[self.fx_px, 0, self.cx_px], [0, self.fy_px, self.cy_px], [0, 0, 1]]
        return np.array(rows, np.float64)

    @property
    def half_diagonal_px(self) -> float:
        """Half the image's diagonal [px], the reference radius of corner blur and distortion."""
        return float(np.hypot(self.width, self.height)) / 2

    def tangent_squared(self) -> Image:
        """Squared tangent of each pixel's angle off the optical axis (h, w)."""
        across = ((np.arange(self.width) - self.cx_px) / self.fx_px) ** 2
        down = ((np.arange(self.height) - self.cy_px) / self.fy_px) ** 2
        return across.astype(np.float32) + down.astype(np.float32)[:, None]

    def angle(self) -> Image:
        """Angle of each pixel's ray off the optical axis (h, w) [rad]."""
        return np.arctan(np.sqrt(self.tangent_squared()))
