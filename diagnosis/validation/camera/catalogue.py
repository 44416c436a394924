"""The table of effects: name, unit, neutral value and range of each strength."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass
from functools import partial
from typing import Literal

from starling.diagnosis.validation.camera.errors import refusal
from starling.diagnosis.validation.camera.nominal import Nominal

Kind = Literal["image", "post", "outside"]
Scale = Literal["difference", "ratio", "choice"]


@dataclass(frozen=True, slots=True)
class EffectRow:
    """One effect. Its strength is the value of the first parameter on the effect page.

    The departure of a value from the neutral is |value - neutral| for the scale `difference` and
    max(value / neutral, neutral / value) - 1 for the scale `ratio`.
    """

    name: str
    unit: str
    neutral: float | str  # A number, or the key of nominal.json that holds it.
    low: float = 0.0  # Least departure.
    high: float = 0.0  # Largest departure.
    _: KW_ONLY
    kind: Kind
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

    def beyond(self, factor: float) -> EffectRow:
        """Return the row with a larger range. Bounds that physics sets stay: 0, and shares of 1."""
        share = self.unit == "1" and self.most <= 1
        most = self.most if share else self.most * factor
        least = self.least / factor if self.least > 0 else self.least
        return dataclasses.replace(self, high=self.high * factor, least=least, most=most)

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
_image, _post, _outside = (partial(EffectRow, kind=kind) for kind in ("image", "post", "outside"))
_ratio = partial(_image, scale="ratio", signs=_BOTH)
# Name, unit, neutral, least and largest departure of each effect.
_TABLE = (
    # Scene.
    _image("ambient", "W m^-2", "ambient_w_m2", 0.01, 25, signs=_BOTH, least=0, most=25),
    _image(
        "ambient_gradient",
        "1",
        "ambient_gradient",
        0.1,
        1,
        signs=_BOTH,
        least=0,
        most=1,
        needs="ambient_w_m2",
    ),
    _image("subsurface", "m", 0, 0.0002, 0.005),
    _image("second_projector", "W", 0, 0.03, 2),
    # Projector.
    _ratio("projector_power", "W", "power_w", 0.1, 3, least=0.02, most=0.45),
    _image("dot_blur", "mrad", 0, 0.2, 4),
    _image("dot_defocus", "mrad m", 0, 0.1, 1.5),
    _image("projector_falloff", "1", 0, 0.5, 6),
    _image("dropped_dots", "1", 0, 0.02, 0.6, most=1),
    _image("shifted_dots", "mrad", 0, 0.3, 8),
    _image("laser_speckle", "1", 0, 0.03, 0.5),
    _image("flicker", "1", 0, 0.01, 0.3),
    # Optics.
    _image("lens_blur", "px", "lens_blur_px", 0.2, 1.5, signs=_BOTH, least=0, most=1.5),
    _image("spot_shape", "1", 0, 0.1, 1, signs=_BOTH, least=-1, most=1),
    _image("corner_blur", "px", 0, 0.2, 2),
    _image("near_defocus", "px m", 0, 0.05, 0.5),
    _image("vignetting", "1", 0, 0.5, 4),
    _image("veil", "1", 0, 0.005, 0.1, most=1),
    _image("distortion", "px", 0, 0.05, 0.5, signs=_BOTH),
    _image("vertical_offset", "px", 0, 0.1, 1.5, signs=_BOTH),
    _image("roll", "deg", 0, 0.02, 0.3, signs=_BOTH),
    _image("pitch", "deg", 0, 0.015, 0.2, signs=_BOTH),
    _image("disparity_offset", "px", 0, 0.05, 1, signs=_BOTH),
    _image("yaw", "deg", 0, 0.005, 0.1, signs=_BOTH),
    _image("focal_scale", "1", 1, 0.002, 0.02, signs=_BOTH, least=0.5),
    # Imager.
    _ratio("exposure", "s", "exposure_s", 0.1, 3, least=0.0005, most=0.033),
    _ratio("gain", "1", "gain", 0.1, 3, least=1, most=15.5),
    _image("crosstalk", "1", 0, 0.01, 0.3, most=1),
    _image("prnu", "1", 0, 0.003, 0.1, most=0.5),
    _image("fixed_pattern", "1", 0, 0.005, 0.1, most=0.5),
    _image("dark_current", "electrons/s", 0, 1, 100000),
    _image("shot_noise", "1", "shot_noise", 0.1, 0.7, signs=_BOTH, least=0.3, most=1),
    _image("read_noise", "electrons", "read_noise_e", 1, 150, signs=_BOTH, least=0, most=150),
    _image("noise_colour", "1", 0, 0.1, 0.8, most=0.9),
    _image("dsnu", "electrons", 0, 1, 60),
    _image("column_noise", "electrons", 0, 1, 40),
    _image("row_noise", "electrons", 0, 1, 40),
    _image("hot_pixels", "1", 0, 1e-5, 0.01, most=1),
    _ratio("saturation", "electrons", "full_well_e", 0.1, 4, least=2000, most=50000),
    _image("blooming", "1", 0, 0.02, 0.5, most=1),
    _image("smoothing", "px", "smoothing_px", 0.3, 1, most=1),
    _ratio("gamma", "1", 1, 0.05, 1.2, least=0.8, most=2.2),
    _image("black_level", "DN", "black_level_dn", 1, 16, signs=_BOTH, least=0, most=16),
    _image("quantisation", "bit", "bit_depth", scale="choice", choices=(8, 10, 12, 16)),
    # Filters of the matched depth.
    _post("median", "px", 0, scale="choice", choices=(3, 5)),
    _post("subpixel_steps", "px", 0, 0.0625, 0.5),
    _post("pixel_locking", "px", 0, 0.02, 0.15, signs=_BOTH),
    _post("speckle_filter", "px", 0, 30, 3000),
    _post("range", "m", 0, 0.1, 1),
    _post("spatial_filter", "1", 1, 0.1, 0.75, signs=(-1,), least=0.25),
    _post("hole_filling", "1", 0, scale="choice", choices=(1, 2, 3)),
    _post("depth_unit", "m", "depth_unit_m", 0.001, 0.009, most=0.01),
    # Outside the table of the diagnosis.
    _outside("lens_ghost", "1", 0, 0.03, 0.3),
    _outside("mains_banding", "1", 0, 0.05, 0.5, most=1),
    _outside("astigmatism", "px", 0, 0.5, 2.5),
    _outside("column_rain", "1", 0, 0.005, 0.05, most=1),
    _outside("brightness_ramp", "1", 0, 0.1, 0.8, most=1),
    _outside("body_offset", "px", 0, 0.8, 3, signs=_BOTH),
    _outside("doubled_dots", "1", 0, 0.1, 0.6),
    _outside("finger_print", "1", 0, 0.2, 0.8, most=1),
    _outside("block_compression", "DN", 0, 3, 20),
)
ROWS = {row.name: row for row in _TABLE}


@dataclass(frozen=True, kw_only=True, slots=True)
class Strengths:
    """Strengths of all effects of one camera: the given values, and the neutral for the rest."""

    nominal: Nominal
    values: Mapping[str, float]

    def __post_init__(self) -> None:
        check_names(self.values)
        for name, value in self.values.items():
            _check_value(name, value, self.nominal)

    def __getitem__(self, name: str) -> float:
        """Return the strength of an effect in the unit of its page."""
        row = ROWS[name]
        return float(self.values.get(name, row.neutral_of(self.nominal)))

    def is_active(self, name: str) -> bool:
        """Return whether the strength of an effect differs from its neutral."""
        return self[name] != ROWS[name].neutral_of(self.nominal)


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
