"""Figures that a data sheet can state, and when a simulated value reaches the stated one."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

Sense = Literal["near", "at most", "at least"]
Interval = tuple[float, float]


@dataclass(frozen=True, kw_only=True, slots=True)
class FigureKind:
    """One figure of a camera."""

    label: str
    unit: str
    sense: Sense  # How a single stated value limits the simulated one.
    plausible: Interval  # Stated values outside are mistakes, mostly of the unit.
    tolerance: float = 0.0  # Of a single value that is met on both sides, in the unit.
    at_distance: bool = False  # Whether the figure depends on the target's distance.
    our_figure: str = ""  # Key of the figure by our definition, if this one is by the vendor's.


_PERCENT = (0.0, 100.0)
_FIELD_DEG = (5.0, 175.0)
_RANGE_M = (0.01, 50.0)
_UNIT_DEG = 1.0  # Rounding and spread of units where the sheet states no tolerance; assumed.
_ROUNDING_MM = 0.5  # Baselines are stated in whole millimetres.
_BAND_PCT = 0.5  # Four columns of 848; the sheets let the firmware's band differ. Assumed.

FIGURES: dict[str, FigureKind] = {
    "horizontal_field_deg": FigureKind(
        label="horizontal field",
        unit="deg",
        sense="near",
        plausible=_FIELD_DEG,
        tolerance=_UNIT_DEG,
    ),
    "horizontal_depth_field_deg": FigureKind(  # The field without the left band.
        label="horizontal field of depth",
        unit="deg",
        sense="near",
        plausible=_FIELD_DEG,
        tolerance=_UNIT_DEG,
        at_distance=True,
    ),
    "vertical_field_deg": FigureKind(
        label="vertical field",
        unit="deg",
        sense="near",
        plausible=_FIELD_DEG,
        tolerance=_UNIT_DEG,
    ),
    "baseline_mm": FigureKind(
        label="baseline",
        unit="mm",
        sense="near",
        plausible=(1.0, 1000.0),
        tolerance=_ROUNDING_MM,
    ),
    "minimum_distance_m": FigureKind(
        label="minimum distance", unit="m", sense="at most", plausible=_RANGE_M
    ),
    "maximum_distance_m": FigureKind(
        label="maximum distance", unit="m", sense="at least", plausible=_RANGE_M
    ),
    "accuracy_pct": FigureKind(
        label="Z accuracy", unit="%", sense="at most", plausible=_PERCENT, at_distance=True
    ),
    "median_error_pct": FigureKind(
        label="Z accuracy by median",
        unit="%",
        sense="at most",
        plausible=_PERCENT,
        at_distance=True,
        our_figure="accuracy_pct",
    ),
    "plane_rms_pct": FigureKind(
        label="plane-fit RMS", unit="%", sense="at most", plausible=_PERCENT, at_distance=True
    ),
    "temporal_noise_pct": FigureKind(
        label="temporal noise", unit="%", sense="at most", plausible=_PERCENT, at_distance=True
    ),
    "fill_pct": FigureKind(
        label="fill rate", unit="%", sense="at least", plausible=_PERCENT, at_distance=True
    ),
    "left_band_pct": FigureKind(
        label="invalid left band, share of the width",
        unit="%",
        sense="near",
        plausible=_PERCENT,
        tolerance=_BAND_PCT,
        at_distance=True,
    ),
    "fill_without_projector_pct": FigureKind(
        label="fill rate, projector off",
        unit="%",
        sense="at most",
        plausible=_PERCENT,
        at_distance=True,
    ),
    "sunlight_change_pct": FigureKind(
        label="change of fill rate in sunlight",
        unit="%",
        sense="at least",
        plausible=(-100.0, 100.0),
        at_distance=True,
    ),
}


def accepted(kind: FigureKind, value: tuple[float, ...]) -> Interval:
    """Return the closed interval of simulated values that reach a stated value.

    Args:
        kind: the figure.
        value: one stated value, or the low and high end of a stated interval.
    """
    if len(value) == 2:
        return value[0], value[1]
    (stated,) = value
    if kind.sense == "at most":
        return -math.inf, stated
    if kind.sense == "at least":
        return stated, math.inf
    return stated - kind.tolerance, stated + kind.tolerance


def reached(kind: FigureKind, value: tuple[float, ...], simulated: float) -> bool:
    """Return whether a simulated value reaches the stated one; NaN does not."""
    low, high = accepted(kind, value)
    return low <= simulated <= high


def stated(kind: FigureKind, value: tuple[float, ...]) -> str:
    """Format a stated value: `<= 2`, `63 to 67`, `50 +- 0.5`."""
    if len(value) == 2:
        return f"{value[0]:g} to {value[1]:g}"
    if kind.sense == "near":
        return f"{value[0]:g} +- {kind.tolerance:g}"
    return f"{'<=' if kind.sense == 'at most' else '>='} {value[0]:g}"
