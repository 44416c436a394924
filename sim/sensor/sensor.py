"""A sensor: one active-stereo depth camera as a tree of frozen dataclasses.

The defaults are neutral: perfect optics, no noise, no post-processing. A preset
(`sim/sensor/presets/*.toml`) has a device's values, with the source of each number.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from starling.patterns import errors
from starling.sim import quantities
from starling.sim.sensor.imager import Alignment as Alignment
from starling.sim.sensor.imager import Imager as Imager
from starling.sim.sensor.imager import Lens as Lens
from starling.sim.sensor.matcher import Matcher, named
from starling.sim.sensor.post import Post as Post
from starling.sim.sensor.projector import Projector as Projector


@dataclass(frozen=True, kw_only=True, slots=True)
class Colour:
    """A pinhole colour camera in the left imager's frame; it does not see projector light."""

    width: int  # [px]
    height: int  # [px]
    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float
    position_m: tuple[float, float, float] = (-0.015, 0.0, 0.0)  # In the left imager's frame [m].
    rotation_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)  # Rotation vector [deg].
    level: float = 0.45  # Auto exposure target: mean of the picture, as a share of full scale.

    def __post_init__(self) -> None:
        for name in ("width", "height"):
            errors.in_interval(f"colour.{name}", getattr(self, name), 32, 8192)
        for name in ("fx_px", "fy_px"):
            quantities.check_focal(f"colour.{name}", getattr(self, name), self.width)
        errors.in_interval("colour.cx_px", self.cx_px, -self.width, 2 * self.width)
        errors.in_interval("colour.cy_px", self.cy_px, -self.height, 2 * self.height)
        errors.vector("colour.position_m", self.position_m, -4.0, 4.0, "Give metres.")
        errors.vector("colour.rotation_deg", self.rotation_deg, -360.0, 360.0)
        errors.in_interval("colour.level", self.level, 0.01, 0.95)


@dataclass(frozen=True, kw_only=True, slots=True)
class Sensor:
    """A rectified pair of imagers, a projector, a matcher and post-processing.

    Frame: OpenCV (x right, y down, z forward, integer coordinate = pixel centre), origin at the
    left imager. A sensor of `kind = "structured_light"` has no right imager. Its left image is
    matched against a stored reference of the projector's pattern, and `baseline_m` is the distance
    between imager and projector.
    """

    name: str
    width: int  # [px]
    height: int  # [px]
    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float
    baseline_m: float
    kind: Literal["stereo", "structured_light"] = "stereo"
    left: Imager = field(default_factory=Imager)
    right: Imager = field(default_factory=Imager)
    projector: Projector = field(default_factory=Projector)
    matcher: Matcher = field(default_factory=lambda: named("d4xx"))
    post: Post = field(default_factory=Post)
    colour: Colour | None = None
    baseline_error: float = 0.0  # True baseline / nominal baseline - 1 (heat, shock).
    unit: int = 0  # Number of the device; it selects the fixed-pattern noise.

    def __post_init__(self) -> None:
        for name in ("width", "height"):
            errors.in_interval(name, getattr(self, name), 32, 8192)
        for name in ("fx_px", "fy_px"):
            quantities.check_focal(name, getattr(self, name), self.width)
        errors.in_interval("cx_px", self.cx_px, -self.width, 2 * self.width)
        errors.in_interval("cy_px", self.cy_px, -self.height, 2 * self.height)
        quantities.check("baseline_m", self.baseline_m, "baseline_m")
        errors.in_interval("baseline_error", self.baseline_error, -0.2, 0.2, "Give a share: 0.01.")
        errors.in_interval("unit", self.unit, 0, 2**31 - 1)
        errors.one_of("kind", self.kind, ("stereo", "structured_light"))
        expected = (self.baseline_m, 0.0, 0.0)
        if self.kind == "structured_light" and not np.allclose(
            self.projector.position_m, expected, rtol=0, atol=1e-9
        ):
            raise errors.refuse(
                "projector.position_m",
                "must be [baseline_m, 0, 0] where the projector takes the right imager's place",
                list(self.projector.position_m),
                f"Set it to {list(expected)}, or baseline_m to match.",
            )

    @property
    def true_baseline_m(self) -> float:
        """Distance of the imagers with the baseline's error [m]."""
        return self.baseline_m * (1 + self.baseline_error)

    @property
    def focal_baseline_px_m(self) -> float:
        """f b [px m]: disparity [px] times depth [m]."""
        return self.fx_px * self.baseline_m
