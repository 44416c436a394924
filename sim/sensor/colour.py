"""The colour camera next to the infrared pair."""

from __future__ import annotations

from dataclasses import dataclass

from starling.patterns import errors


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
            errors.positive(f"colour.{name}", getattr(self, name))
        errors.in_interval("colour.cx_px", self.cx_px, -self.width, 2 * self.width)
        errors.in_interval("colour.cy_px", self.cy_px, -self.height, 2 * self.height)
        for axis, value in zip("xyz", self.position_m, strict=True):
            errors.in_interval(f"colour.position_m.{axis}", value, -4.0, 4.0, "Give metres.")
        for axis, value in zip("xyz", self.rotation_deg, strict=True):
            errors.in_interval(f"colour.rotation_deg.{axis}", value, -360.0, 360.0)
        errors.in_interval("colour.level", self.level, 0.01, 0.95)
