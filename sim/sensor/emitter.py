"""One of several emitters in a projector."""

from __future__ import annotations

from dataclasses import dataclass

from starling.patterns import errors


@dataclass(frozen=True, kw_only=True, slots=True)
class Emitter:
    """One laser with its optics and pattern, posed in the projector's frame."""

    offset_m: tuple[float, float, float] = (0.0, 0.0, 0.0)  # In the projector's frame [m].
    rotation_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)  # Rotation vector [deg].
    pattern: str = ""  # As `Projector.pattern`, which is used if this is empty.
    power_share: float = 1.0  # Weight of its power; normalised over all emitters.

    def __post_init__(self) -> None:
        name = "projector.emitters"
        for axis, value in zip("xyz", self.offset_m, strict=True):
            errors.in_interval(f"{name}.offset_m.{axis}", value, -0.5, 0.5, "Give metres.")
        for axis, value in zip("xyz", self.rotation_deg, strict=True):
            errors.in_interval(f"{name}.rotation_deg.{axis}", value, -360.0, 360.0)
        errors.positive(f"{name}.power_share", self.power_share, "Leave a dark emitter out.")
