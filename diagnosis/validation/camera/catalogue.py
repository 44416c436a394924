"""The table of effects: what each is called, what moves it and how far it may be moved."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from starling.diagnosis.validation.camera.errors import refusal
from starling.diagnosis.validation.camera.nominal import Nominal

Kind = Literal["image", "post", "outside"]
Scale = Literal["difference", "ratio", "choice"]


@dataclass(frozen=True, kw_only=True, slots=True)
class Row:
    """One effect. A strength is the absolute value of the first parameter of the effect's page.

    The departure of a value from its neutral is |value - neutral| for `difference` and
    max(value / neutral, neutral / value) - 1 for `ratio`.
    """

    name: str
    kind: Kind
    unit: str
    neutral: float | str  # A number, or the key of nominal.json that holds it.
    low: float = 0.0  # Least and largest departure.
    high: float = 0.0
    scale: Scale = "difference"
    signs: tuple[int, ...] = (1,)
    least: float = -math.inf  # Bounds of the value itself.
    most: float = math.inf
    choices: tuple[float, ...] = ()
    needs: str | None = None  # Key of nominal.json that must be above 0, else nothing happens.

    def neutral_of(self, nominal: Nominal) -> float:
        """Value at which the effect does nothing for this camera."""
        if isinstance(self.neutral, str):
            return float(getattr(nominal, self.neutral))
        return self.neutral

    def reach(self, nominal: Nominal, sign: int) -> float:
        """Largest departure that this camera allows to one side, 0 if none."""
        neutral = self.neutral_of(nominal)
        room = self.most - neutral if sign > 0 else neutral - self.least
        if self.scale == "ratio":
            room = (self.most / neutral if sign > 0 else neutral / self.least) - 1.0
        return max(min(self.high, room), 0.0)

    def value(self, nominal: Nominal, departure: float, sign: int) -> float:
        """Strength at a departure >= 0 to one side of the neutral."""
        neutral = self.neutral_of(nominal)
        if self.scale == "ratio":
            return neutral * (1.0 + departure) ** sign
        return neutral + sign * departure

    def departure(self, nominal: Nominal, value: float) -> float:
        """How far a strength is from the neutral, >= 0; for choices 0 or 1."""
        return self.apart(self.neutral_of(nominal), value)

    def apart(self, neutral: float, value: float) -> float:
        """How far a strength is from that of a camera that has `neutral`, likewise."""
        if self.scale == "ratio":
            return max(value / neutral, neutral / value) - 1.0
        if self.scale == "choice":
            return float(value != neutral)
        return abs(value - neutral)

    def acts(self, nominal: Nominal) -> bool:
        """Tell whether this camera can show the effect at all."""
        return self.needs is None or getattr(nominal, self.needs) > 0


_BOTH = (1, -1)
_IMAGE = (
    # Scene.
    Row(name="ambient", kind="image", unit="W m^-2", neutral="ambient_w_m2",
        low=0.01, high=25, signs=_BOTH, least=0, most=25),
    Row(name="ambient_gradient", kind="image", unit="1",
        neutral="ambient_gradient", low=0.1, high=1, signs=_BOTH, least=0, most=1,
        needs="ambient_w_m2"),
    Row(name="subsurface", kind="image", unit="m", neutral=0,
        low=0.0002, high=0.005),
    Row(name="second_projector", kind="image", unit="W", neutral=0,
        low=0.03, high=2),
    # Projector.
    Row(name="projector_power", kind="image", unit="W", neutral="power_w",
        low=0.1, high=3, scale="ratio", signs=_BOTH, least=0.02, most=0.45),
    Row(name="dot_blur", kind="image", unit="mrad", neutral=0,
        low=0.2, high=4),
    Row(name="dot_defocus", kind="image", unit="mrad m", neutral=0,
        low=0.1, high=1.5),
    Row(name="projector_falloff", kind="image", unit="1", neutral=0,
        low=0.5, high=6),
    Row(name="dropped_dots", kind="image", unit="1", neutral=0,
        low=0.02, high=0.6, most=1),
    Row(name="shifted_dots", kind="image", unit="mrad", neutral=0,
        low=0.3, high=8),
    Row(name="laser_speckle", kind="image", unit="1", neutral=0,
        low=0.03, high=0.5),
    Row(name="flicker", kind="image", unit="1", neutral=0, low=0.01, high=0.3),
    # Optics.
    Row(name="lens_blur", kind="image", unit="px", neutral="lens_blur_px",
        low=0.2, high=1.5, signs=_BOTH, least=0, most=1.5),
    Row(name="corner_blur", kind="image", unit="px", neutral=0,
        low=0.2, high=2),
    Row(name="near_defocus", kind="image", unit="px m", neutral=0,
        low=0.05, high=0.5),
    Row(name="vignetting", kind="image", unit="1", neutral=0,
        low=0.5, high=4),
    Row(name="veil", kind="image", unit="1", neutral=0, low=0.005, high=0.1,
        most=1),
    Row(name="distortion", kind="image", unit="px", neutral=0,
        low=0.05, high=0.5, signs=_BOTH),
    Row(name="vertical_offset", kind="image", unit="px", neutral=0,
        low=0.1, high=1.5, signs=_BOTH),
    Row(name="roll", kind="image", unit="deg", neutral=0,
        low=0.02, high=0.3, signs=_BOTH),
    Row(name="pitch", kind="image", unit="deg", neutral=0,
        low=0.015, high=0.2, signs=_BOTH),
    Row(name="disparity_offset", kind="image", unit="px", neutral=0,
        low=0.05, high=1, signs=_BOTH),
    Row(name="yaw", kind="image", unit="deg", neutral=0,
        low=0.005, high=0.1, signs=_BOTH),
    Row(name="focal_scale", kind="image", unit="1", neutral=1,
        low=0.002, high=0.02, signs=_BOTH, least=0.5),
    # Imager.
    Row(name="exposure", kind="image", unit="s", neutral="exposure_s",
        low=0.1, high=3, scale="ratio", signs=_BOTH, least=0.0005, most=0.033),
    Row(name="gain", kind="image", unit="1", neutral="gain",
        low=0.1, high=3, scale="ratio", signs=_BOTH, least=1, most=15.5),
    Row(name="crosstalk", kind="image", unit="1", neutral=0,
        low=0.01, high=0.3, most=1),
    Row(name="prnu", kind="image", unit="1", neutral=0,
        low=0.003, high=0.1, most=0.5),
    Row(name="dark_current", kind="image", unit="electrons / s", neutral=0,
        low=1, high=100000),
    Row(name="shot_noise", kind="image", unit="1", neutral="shot_noise",
        low=0.1, high=0.7, signs=_BOTH, least=0.3, most=1),
    Row(name="read_noise", kind="image", unit="electrons",
        neutral="read_noise_e", low=1, high=150, signs=_BOTH, least=0, most=150),
    Row(name="dsnu", kind="image", unit="electrons", neutral=0,
        low=1, high=60),
    Row(name="column_noise", kind="image", unit="electrons", neutral=0,
        low=1, high=40),
    Row(name="row_noise", kind="image", unit="electrons", neutral=0,
        low=1, high=40),
    Row(name="hot_pixels", kind="image", unit="1", neutral=0,
        low=1e-5, high=0.01, most=1),
    Row(name="saturation", kind="image", unit="electrons",
        neutral="full_well_e", low=0.1, high=4, scale="ratio", signs=_BOTH, least=2000,
        most=50000),
    Row(name="blooming", kind="image", unit="1", neutral=0,
        low=0.02, high=0.5, most=1),
    Row(name="smoothing", kind="image", unit="px", neutral="smoothing_px",
        low=0.3, high=1, most=1),
    Row(name="gamma", kind="image", unit="1", neutral=1,
        low=0.05, high=1.2, scale="ratio", signs=_BOTH, least=0.8, most=2.2),
    Row(name="black_level", kind="image", unit="DN",
        neutral="black_level_dn", low=1, high=16, signs=_BOTH, least=0, most=16),
    Row(name="quantisation", kind="image", unit="bit",
        neutral="bit_depth", scale="choice", choices=(8, 10, 12, 16)),
)  # fmt: skip
_POST = (
    Row(name="median", kind="post", unit="px", neutral=0,
        scale="choice", choices=(3, 5)),
    Row(name="subpixel_steps", kind="post", unit="px", neutral=0,
        low=0.0625, high=0.5),
    Row(name="pixel_locking", kind="post", unit="px", neutral=0,
        low=0.02, high=0.15, signs=_BOTH),
    Row(name="speckle_filter", kind="post", unit="px", neutral=0,
        low=30, high=3000),
    Row(name="range", kind="post", unit="m", neutral=0, low=0.1, high=1),
    Row(name="spatial_filter", kind="post", unit="1", neutral=1,
        low=0.1, high=0.75, signs=(-1,), least=0.25),
    Row(name="hole_filling", kind="post", unit="1", neutral=0,
        scale="choice", choices=(1, 2, 3)),
    Row(name="depth_unit", kind="post", unit="m", neutral="depth_unit_m",
        low=0.001, high=0.009, most=0.01),
)  # fmt: skip
_OUTSIDE = (
    Row(name="lens_ghost", kind="outside", unit="1", neutral=0,
        low=0.03, high=0.3),
    Row(name="mains_banding", kind="outside", unit="1", neutral=0,
        low=0.05, high=0.5, most=1),
    Row(name="astigmatism", kind="outside", unit="px", neutral=0,
        low=0.5, high=2.5),
    Row(name="column_rain", kind="outside", unit="1", neutral=0,
        low=0.005, high=0.05, most=1),
    Row(name="brightness_ramp", kind="outside", unit="1", neutral=0,
        low=0.1, high=0.8, most=1),
    Row(name="body_offset", kind="outside", unit="px", neutral=0,
        low=0.8, high=3, signs=_BOTH),
    Row(name="doubled_dots", kind="outside", unit="1", neutral=0,
        low=0.1, high=0.6),
    Row(name="finger_print", kind="outside", unit="1", neutral=0,
        low=0.2, high=0.8, most=1),
    Row(name="block_compression", kind="outside", unit="DN", neutral=0,
        low=3, high=20),
)  # fmt: skip

ROWS = {row.name: row for row in (*_IMAGE, *_POST, *_OUTSIDE)}


@dataclass(frozen=True, kw_only=True, slots=True)
class Strengths:
    """Strength of every effect of one camera: those set, and the neutral of all others."""

    nominal: Nominal
    values: Mapping[str, float]

    def __post_init__(self) -> None:
        check_names(self.values)
        for name, value in self.values.items():
            _check_value(name, value, self.nominal)

    def of(self, name: str) -> float:
        """Strength of an effect in the unit of its page."""
        row = ROWS[name]
        return float(self.values.get(name, row.neutral_of(self.nominal)))

    def acting(self, name: str) -> bool:
        """Tell whether an effect is away from its neutral."""
        return self.of(name) != ROWS[name].neutral_of(self.nominal)


def check_names(values: Mapping[str, float]) -> None:
    """Refuse names that are no effects.

    Raises:
        WithheldError: for the first such name.
    """
    for name in values:
        if name not in ROWS:
            raise refusal("effect", "must be one of the table", name, "Take one of catalogue.ROWS.")


def _check_value(name: str, value: float, nominal: Nominal) -> None:
    if not math.isfinite(value):
        raise refusal(name, "must be finite", value, "Give a number.")
    row = ROWS[name]
    if row.scale == "choice":
        allowed = sorted({*row.choices, row.neutral_of(nominal)})
        if value not in allowed:
            raise refusal(name, f"must be one of {allowed}", value, "Give one of them.")
        return
    signed = -1 in row.signs and row.neutral == 0
    if (value < 0 and not signed) or (value == 0 and row.scale == "ratio"):
        raise refusal(name, "must not be below its range", value, "Give more.")
    if row.unit == "1" and row.most == 1 and value > 1:
        raise refusal(name, "must be at most 1", value, "Give a share.")
