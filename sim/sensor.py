"""A sensor: one active-stereo depth camera as a tree of frozen dataclasses.

Defaults are the *neutral* values: perfect optics, no noise, no post-processing. A preset
(`sim/sensors/*.toml`) says what a device has instead, with the source of each number.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from patterns import errors
from sim.matcher import Matcher, named


@dataclass(frozen=True, kw_only=True, slots=True)
class Imager:
    """One global-shutter near-infrared imager, linear below saturation (EMVA 1288 model)."""

    exposure_s: float = 8.5e-3  # Integration time with auto exposure off [s].
    gain: float = 1.0  # Analog gain, times the base conversion.
    auto_exposure_level: float = 0.0  # Mean signal auto exposure aims at, of full scale; 0 is off.
    auto_exposure_max_s: float = 33e-3  # Longest exposure auto exposure takes [s].
    f_number: float = 2.0  # Lens aperture number.
    transmission: float = 1.0  # Of lens and band-pass filter at the laser's wavelength.
    quantum_efficiency: float = 1.0  # Electrons per photon at the laser's wavelength.
    pixel_pitch_m: float = 3.0e-6  # Side of a pixel's light-collecting square [m].
    full_well_e: float = 1.0e4  # Electrons that fill the scale at gain 1.
    shot_noise: float = 0.0  # Share of the Poisson deviation: 0 none, 1 physical.
    read_noise_e: float = 0.0  # RMS at the pixel [electrons].
    black_level_dn: float = 0.0  # Pedestal [DN].
    bit_depth: int = 16  # Bits of the converter.
    blur_px: float = 0.0  # Sigma of the lens's Gaussian spot [px].

    def __post_init__(self) -> None:
        for name in ("exposure_s", "gain", "auto_exposure_max_s", "f_number", "pixel_pitch_m"):
            errors.positive(f"imager.{name}", getattr(self, name))
        errors.positive("imager.full_well_e", self.full_well_e)
        for name in ("transmission", "quantum_efficiency"):
            errors.in_interval(f"imager.{name}", getattr(self, name), 1e-6, 1.0)
        errors.in_interval("imager.auto_exposure_level", self.auto_exposure_level, 0.0, 0.9)
        errors.in_interval("imager.shot_noise", self.shot_noise, 0.0, 1.0)
        errors.in_interval("imager.read_noise_e", self.read_noise_e, 0.0, 1e4)
        if self.bit_depth not in (8, 10, 12, 16):
            raise errors.refuse(
                "imager.bit_depth",
                "must be 8, 10, 12 or 16",
                repr(self.bit_depth),
                "Real depth cameras have 8 or 10.",
            )
        errors.in_interval("imager.black_level_dn", self.black_level_dn, 0.0, self.ceiling_dn / 2)
        errors.in_interval("imager.blur_px", self.blur_px, 0.0, 20.0)

    @property
    def ceiling_dn(self) -> int:
        """Highest code of the converter [DN]."""
        return 2**self.bit_depth - 1

    @property
    def saturation_dn(self) -> int:
        """Code that a full pixel gives: the ceiling, or less at a gain below 1 [DN]."""
        full = self.full_well_e * self.dn_per_electron + self.black_level_dn
        return min(self.ceiling_dn, round(full))

    @property
    def dn_per_electron(self) -> float:
        """Conversion at this gain [DN / electron]."""
        return self.gain * self.ceiling_dn / self.full_well_e


@dataclass(frozen=True, kw_only=True, slots=True)
class Projector:
    """The infrared pattern projector, posed in the left imager's frame."""

    power_w: float = 0.15  # Mean optical power [W] while exposing; 0 is off (passive stereo).
    wavelength_nm: float = 850.0  # Laser line [nm].
    position_m: tuple[float, float, float] = (0.0, 0.0, 0.0)  # In the left imager's frame [m].
    rotation_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)  # Rotation vector [deg].
    fov_x_deg: float = 90.0  # Full horizontal field [deg].
    fov_y_deg: float = 63.0  # Full vertical field [deg].
    pattern: str = "d435"  # A generator's name (see `patterns`) or an image file.
    pattern_seed: int = 0  # Seed of the generator.
    falloff: float = 0.0  # Exponent n of cos^n about the projector's axis; 0 is none.

    def __post_init__(self) -> None:
        errors.in_interval("projector.power_w", self.power_w, 0.0, 1e3)
        errors.in_interval("projector.wavelength_nm", self.wavelength_nm, 300.0, 1100.0)
        for name in ("position_m", "rotation_deg"):
            for axis, value in zip("xyz", getattr(self, name), strict=True):
                errors.in_interval(f"projector.{name}.{axis}", value, -360.0, 360.0)
        errors.in_interval("projector.fov_x_deg", self.fov_x_deg, 1.0, 150.0)
        errors.in_interval("projector.fov_y_deg", self.fov_y_deg, 1.0, 150.0)
        errors.in_interval("projector.falloff", self.falloff, 0.0, 20.0)
        if not self.pattern:
            raise errors.refuse(
                "projector.pattern", "must name a pattern", "''", "Give a name or an image file."
            )


@dataclass(frozen=True, kw_only=True, slots=True)
class Post:
    """From disparity to the depth that leaves the device."""

    depth_unit_m: float = 1e-3  # Step of the 16-bit depth image [m].
    near_m: float = 0.0  # Nearer is out of range [m].
    far_m: float = 65.535  # Farther is out of range [m].

    def __post_init__(self) -> None:
        errors.positive("post.depth_unit_m", self.depth_unit_m)
        errors.in_interval("post.near_m", self.near_m, 0.0, 1e3)
        errors.in_interval("post.far_m", self.far_m, 0.0, 1e3)
        if self.far_m <= self.near_m:
            raise errors.refuse(
                "post.far_m", "must be > post.near_m", repr(self.far_m), "Swap or widen the range."
            )


@dataclass(frozen=True, kw_only=True, slots=True)
class Sensor:
    """A rectified pair of imagers, a projector, a matcher and what follows.

    Frame: OpenCV (x right, y down, z forward, integer coordinate = pixel centre), origin at the
    left imager. With `kind = "structured_light"` there is no right imager: the left image is
    matched against the stored reference of the projector's own pattern, and `baseline_m` is
    the distance between imager and projector.
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

    def __post_init__(self) -> None:
        for name in ("width", "height"):
            errors.in_interval(name, getattr(self, name), 32, 8192)
        for name in ("fx_px", "fy_px"):
            errors.positive(name, getattr(self, name))
        errors.in_interval("cx_px", self.cx_px, -self.width, 2 * self.width)
        errors.in_interval("cy_px", self.cy_px, -self.height, 2 * self.height)
        errors.positive(
            "baseline_m", self.baseline_m, "The left imager comes first: give the distance [m]."
        )
        errors.one_of("kind", self.kind, ("stereo", "structured_light"))
        beside = (self.baseline_m, 0.0, 0.0)
        if self.kind == "structured_light" and not np.allclose(
            self.projector.position_m, beside, rtol=0, atol=1e-9
        ):
            raise errors.refuse(
                "projector.position_m",
                "must be [baseline_m, 0, 0] where the projector takes the right imager's place",
                list(self.projector.position_m),
                f"Set it to {list(beside)}, or baseline_m to match.",
            )

    @property
    def focal_baseline_px_m(self) -> float:
        """f b [px m]: disparity [px] times depth [m]."""
        return self.fx_px * self.baseline_m
