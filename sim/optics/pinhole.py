"""Where an imager's pixels look: the pinhole that rectification promises."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sim.layers import Image

if TYPE_CHECKING:
    from sim.sensor import Sensor


@dataclass(frozen=True, kw_only=True, slots=True)
class Pinhole:
    """Size and intrinsics [px] of either imager of a rectified pair."""

    width: int
    height: int
    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float

    @classmethod
    def of(cls, sensor: Sensor) -> Pinhole:
        """The pinhole that both imagers of a sensor share."""
        return cls(
            width=sensor.width,
            height=sensor.height,
            fx_px=sensor.fx_px,
            fy_px=sensor.fy_px,
            cx_px=sensor.cx_px,
            cy_px=sensor.cy_px,
        )

    @property
    def half_diagonal_px(self) -> float:
        """Half the image's diagonal [px]: the radius at which what grows outwards is stated."""
        return float(np.hypot(self.width, self.height)) / 2

    def tangent_squared(self) -> Image:
        """Squared tangent of each pixel's angle off the optical axis (h, w)."""
        across = ((np.arange(self.width) - self.cx_px) / self.fx_px) ** 2
        down = ((np.arange(self.height) - self.cy_px) / self.fy_px) ** 2
        return across.astype(np.float32) + down.astype(np.float32)[:, None]

    def angle(self) -> Image:
        """Angle of each pixel's ray off the optical axis (h, w) [rad]."""
        return np.arctan(np.sqrt(self.tangent_squared()))
