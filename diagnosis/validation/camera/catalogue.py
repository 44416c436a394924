"""The table of effects: name, unit, neutral value and range of each strength."""

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
class EffectRow:
    """One effect. Its strength is the value of the first parameter on the effect page.

    The departure of a value from the neutral is |value - neutral| for the scale `difference` and
    max(value / neutral, neutral / value) - 1 for the scale `ratio`.
    """

    name: str
    kind: Kind
    unit: str
    neutral: float | str  # A number, or the key of nominal.json that holds it.
    low: float = 0.0  # Least departure.
    high: float = 0.0  # Largest departure.
    scale: Scale = "difference"
    signs: tuple[int, ...] = (1,)  # Sides of the neutral to which the effect may depart.
    least: float = -math.inf  # Lower bound of the value.
    most: float = math.inf  # Upper bound of the value.
    choices: tuple[float, ...] = ()  # Values of an effect of scale `choice`.
    needs: str | None = None  # Key of nominal.json that must be > 0 for the effect to show.

    def neutral_of(self, nominal: Nominal) -> float:
        """Return the value at which the effect is inactive for this camera."""
        if isinstance(self.neutral, str):
            return float(getattr(nominal, self.neutral))
        return self.neutral

    def reach(self, nominal: Nominal, sign: int) -> float:
        """Return the largest departure that this camera allows on one side, 0 if none."""
        neutral = self.neutral_of(nominal)
        room = self.most - neutral if sign > 0 else neutral - self.least
        if self.scale == "ratio":
            room = (self.most / neutral if sign > 0 else neutral / self.least) - 1.0
        return max(min(self.high, room), 0.0)

    def value(self, nominal: Nominal, departure: float, sign: int) -> float:
        """Return the strength at a departure >= 0 on one side of the neutral."""
        neutral = self.neutral_of(nominal)
        if self.scale == "ratio":
            return neutral * (1.0 + departure) ** sign
        return neutral + sign * departure

    def departure(self, nominal: Nominal, value: float) -> float:
        """Return the departure of a strength from the neutral, >= 0; for choices 0 or 1."""
        return self.departure_from(self.neutral_of(nominal), value)

    def departure_from(self, neutral: float, value: float) -> float:
        """Return the departure of a strength from a given neutral, >= 0; for choices 0 or 1."""
        if self.scale == "ratio":
            return max(value / neutral, neutral / value) - 1.0
        if self.scale == "choice":
            return float(value != neutral)
        return abs(value - neutral)

    def applies_to(self, nominal: Nominal) -> bool:
        """Return whether this camera can show the effect."""
        return self.needs is None or getattr(nominal, self.needs) > 0


_BOTH = (1, -1)
_IMAGE = (
    # Scene.
    EffectRow(name="ambient", kind="image", unit="W m^-2", neutral="ambient_w_m2",
        low=0.01, high=25, signs=_BOTH, least=0, most=25),
    EffectRow(name="ambient_gradient", kind="image", unit="1",
        neutral="ambient_gradient", low=0.1, high=1, signs=_BOTH, least=0, most=1,
        needs="ambient_w_m2"),
    EffectRow(name="subsurface", kind="image", unit="m", neutral=0,
        low=0.0002, high=0.005),
    EffectRow(name="second_projector", kind="image", unit="W", neutral=0,
        low=0.03, high=2),
    # Projector.
    EffectRow(name="projector_power", kind="image", unit="W", neutral="power_w",
        low=0.1, high=3, scale="ratio", signs=_BOTH, least=0.02, most=0.45),
    EffectRow(name="dot_blur", kind="image", unit="mrad", neutral=0,
        low=0.2, high=4),
    EffectRow(name="dot_defocus", kind="image", unit="mrad m", neutral=0,
        low=0.1, high=1.5),
    EffectRow(name="projector_falloff", kind="image", unit="1", neutral=0,
        low=0.5, high=6),
    EffectRow(name="dropped_dots", kind="image", unit="1", neutral=0,
        low=0.02, high=0.6, most=1),
    EffectRow(name="shifted_dots", kind="image", unit="mrad", neutral=0,
        low=0.3, high=8),
    EffectRow(name="laser_speckle", kind="image", unit="1", neutral=0,
        low=0.03, high=0.5),
    EffectRow(name="flicker", kind="image", unit="1", neutral=0, low=0.01, high=0.3),
    # Optics.
    EffectRow(name="lens_blur", kind="image", unit="px", neutral="lens_blur_px",
        low=0.2, high=1.5, signs=_BOTH, least=0, most=1.5),
    EffectRow(name="corner_blur", kind="image", unit="px", neutral=0,
        low=0.2, high=2),
    EffectRow(name="near_defocus", kind="image", unit="px m", neutral=0,
        low=0.05, high=0.5),
    EffectRow(name="vignetting", kind="image", unit="1", neutral=0,
        low=0.5, high=4),
    EffectRow(name="veil", kind="image", unit="1", neutral=0, low=0.005, high=0.1,
        most=1),
    EffectRow(name="distortion", kind="image", unit="px", neutral=0,
        low=0.05, high=0.5, signs=_BOTH),
    EffectRow(name="vertical_offset", kind="image", unit="px", neutral=0,
        low=0.1, high=1.5, signs=_BOTH),
    EffectRow(name="roll", kind="image", unit="deg", neutral=0,
        low=0.02, high=0.3, signs=_BOTH),
    EffectRow(name="pitch", kind="image", unit="deg", neutral=0,
        low=0.015, high=0.2, signs=_BOTH),
    EffectRow(name="disparity_offset", kind="image", unit="px", neutral=0,
        low=0.05, high=1, signs=_BOTH),
    EffectRow(name="yaw", kind="image", unit="deg", neutral=0,
        low=0.005, high=0.1, signs=_BOTH),
    EffectRow(name="focal_scale", kind="image", unit="1", neutral=1,
        low=0.002, high=0.02, signs=_BOTH, least=0.5),
    # Imager.
    EffectRow(name="exposure", kind="image", unit="s", neutral="exposure_s",
        low=0.1, high=3, scale="ratio", signs=_BOTH, least=0.0005, most=0.033),
    EffectRow(name="gain", kind="image", unit="1", neutral="gain",
        low=0.1, high=3, scale="ratio", signs=_BOTH, least=1, most=15.5),
    EffectRow(name="crosstalk", kind="image", unit="1", neutral=0,
        low=0.01, high=0.3, most=1),
    EffectRow(name="prnu", kind="image", unit="1", neutral=0,
        low=0.003, high=0.1, most=0.5),
    EffectRow(name="dark_current", kind="image", unit="electrons / s", neutral=0,
        low=1, high=100000),
    EffectRow(name="shot_noise", kind="image", unit="1", neutral="shot_noise",
        low=0.1, high=0.7, signs=_BOTH, least=0.3, most=1),
    EffectRow(name="read_noise", kind="image", unit="electrons",
        neutral="read_noise_e", low=1, high=150, signs=_BOTH, least=0, most=150),
    EffectRow(name="dsnu", kind="image", unit="electrons", neutral=0,
        low=1, high=60),
    EffectRow(name="column_noise", kind="image", unit="electrons", neutral=0,
        low=1, high=40),
    EffectRow(name="row_noise", kind="image", unit="electrons", neutral=0,
        low=1, high=40),
    EffectRow(name="hot_pixels", kind="image", unit="1", neutral=0,
        low=1e-5, high=0.01, most=1),
    EffectRow(name="saturation", kind="image", unit="electrons",
        neutral="full_well_e", low=0.1, high=4, scale="ratio", signs=_BOTH, least=2000,
        most=50000),
    EffectRow(name="blooming", kind="image", unit="1", neutral=0,
        low=0.02, high=0.5, most=1),
    EffectRow(name="smoothing", kind="image", unit="px", neutral="smoothing_px",
        low=0.3, high=1, most=1),
    EffectRow(name="gamma", kind="image", unit="1", neutral=1,
        low=0.05, high=1.2, scale="ratio", signs=_BOTH, least=0.8, most=2.2),
    EffectRow(name="black_level", kind="image", unit="DN",
        neutral="black_level_dn", low=1, high=16, signs=_BOTH, least=0, most=16),
    EffectRow(name="quantisation", kind="image", unit="bit",
        neutral="bit_depth", scale="choice", choices=(8, 10, 12, 16)),
)  # fmt: skip
_POST = (
    EffectRow(name="median", kind="post", unit="px", neutral=0,
        scale="choice", choices=(3, 5)),
    EffectRow(name="subpixel_steps", kind="post", unit="px", neutral=0,
        low=0.0625, high=0.5),
    EffectRow(name="pixel_locking", kind="post", unit="px", neutral=0,
        low=0.02, high=0.15, signs=_BOTH),
    EffectRow(name="speckle_filter", kind="post", unit="px", neutral=0,
        low=30, high=3000),
    EffectRow(name="range", kind="post", unit="m", neutral=0, low=0.1, high=1),
    EffectRow(name="spatial_filter", kind="post", unit="1", neutral=1,
        low=0.1, high=0.75, signs=(-1,), least=0.25),
    EffectRow(name="hole_filling", kind="post", unit="1", neutral=0,
        scale="choice", choices=(1, 2, 3)),
    EffectRow(name="depth_unit", kind="post", unit="m", neutral="depth_unit_m",
        low=0.001, high=0.009, most=0.01),
)  # fmt: skip
_OUTSIDE = (
    EffectRow(name="lens_ghost", kind="outside", unit="1", neutral=0,
        low=0.03, high=0.3),
    EffectRow(name="mains_banding", kind="outside", unit="1", neutral=0,
        low=0.05, high=0.5, most=1),
    EffectRow(name="astigmatism", kind="outside", unit="px", neutral=0,
        low=0.5, high=2.5),
    EffectRow(name="column_rain", kind="outside", unit="1", neutral=0,
        low=0.005, high=0.05, most=1),
    EffectRow(name="brightness_ramp", kind="outside", unit="1", neutral=0,
        low=0.1, high=0.8, most=1),
    EffectRow(name="body_offset", kind="outside", unit="px", neutral=0,
        low=0.8, high=3, signs=_BOTH),
    EffectRow(name="doubled_dots", kind="outside", unit="1", neutral=0,
        low=0.1, high=0.6),
    EffectRow(name="finger_print", kind="outside", unit="1", neutral=0,
        low=0.2, high=0.8, most=1),
    EffectRow(name="block_compression", kind="outside", unit="DN", neutral=0,
        low=3, high=20),
)  # fmt: skip

ROWS = {row.name: row for row in (*_IMAGE, *_POST, *_OUTSIDE)}


@dataclass(frozen=True, kw_only=True, slots=True)
class Strengths:
    """Strengths of all effects of one camera: the given values, and the neutral for the rest."""

    nominal: Nominal
    values: Mapping[str, float]

    def __post_init__(self) -> None:
        check_names(self.values)
        for name, value in self.values.items():
            _check_value(name, value, self.nominal)

    def value(self, name: str) -> float:
        """Return the strength of an effect in the unit of its page."""
        row = ROWS[name]
        return float(self.values.get(name, row.neutral_of(self.nominal)))

    def is_active(self, name: str) -> bool:
        """Return whether the strength of an effect differs from its neutral."""
        return self.value(name) != ROWS[name].neutral_of(self.nominal)


def check_names(values: Mapping[str, float]) -> None:
    """Check that all names are effects of the table.

    Raises:
        WithheldError: for the first unknown name.
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
