"""Plausible ranges of physical quantities, for values from files and flags.

A value of the right type and sign can still be impossible, mostly because its unit differs. The
ranges are wide: they exclude wrong units and inverted matrices, no real device.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from starling.patterns import errors
from starling.sim.geometry import frames


@dataclass(frozen=True, kw_only=True, slots=True)
class PlausibleRange:
    """Closed range of a quantity, and the likely cause of a value outside."""

    low: float
    high: float
    remedy: str


QUANTITIES = {
    "image_side_px": PlausibleRange(low=1, high=16384, remedy="Give the image size [px]."),
    # A fisheye of 170 degrees has 0.04 image widths; a telescope of 0.1 degrees has 570.
    "focal_widths": PlausibleRange(
        low=0.02, high=1e4, remedy="Give pixels; is the matrix inverted?"
    ),
    "principal_point_px": PlausibleRange(
        low=-1e5, high=1e5, remedy="Give the principal point [px]."
    ),
    # Endoscopes have millimetres, rigs on vehicles a few metres.
    "baseline_m": PlausibleRange(
        low=5e-4, high=10, remedy="The left imager comes first; give metres."
    ),
    "depth_unit_m": PlausibleRange(low=1e-7, high=0.1, remedy="Give the step of depth.png [m]."),
    "time_s": PlausibleRange(low=0, high=1e10, remedy="Give seconds: divide nanoseconds by 1e9."),
    # Some loggers write 0 for an unknown exposure or gain.
    "exposure_s": PlausibleRange(low=0, high=10, remedy="Give seconds."),
    "gain": PlausibleRange(low=0, high=1e5, remedy="Give a factor, or the device's own number."),
    "laser_power": PlausibleRange(
        low=0, high=1e5, remedy="Give the device's own number, mW or percent."
    ),
    # At 10 frames a second, 1e8 frames take four months.
    "frames_of_a_set": PlausibleRange(
        low=1, high=1e8, remedy="Split the plan into plans of other seeds."
    ),
    "coordinate_m": PlausibleRange(
        low=-frames.FARTHEST_M, high=frames.FARTHEST_M, remedy="Give metres; subtract an offset."
    ),
    # Single precision resolves a ten-thousandth of a texture at 1e3 widths.
    "uv": PlausibleRange(low=-1e3, high=1e3, remedy="1 is the texture's width."),
    "unit_length": PlausibleRange(low=0.999, high=1.001, remedy="Divide it by its length."),
    "texture": PlausibleRange(low=0, high=1, remedy="Give the reflectance."),
    "colour": PlausibleRange(low=0, high=1, remedy="Give the linear visible reflectance."),
    # Captured rooms have up to 100.
    "ambient_share": PlausibleRange(low=0, high=1e3, remedy="1 is the scene's ambient light."),
}


def check(name: str, value: float, quantity: str) -> None:
    """Refuse a value outside the plausible range of its quantity.

    Args:
        name: name of the value in the user's words: `baseline_m`.
        value: value in the quantity's unit.
        quantity: key of `QUANTITIES`.

    Raises:
        InputError: if the value is no finite number, or is implausible.
    """
    _check(name, value, QUANTITIES[quantity], scale=1)


def is_plausible(value: float, quantity: str) -> bool:
    """Return whether a number is in the plausible range of its quantity."""
    plausible = QUANTITIES[quantity]
    return bool(plausible.low <= value <= plausible.high)


def check_array(name: str, values: NDArray[Any], quantity: str) -> None:
    """Refuse an array of real numbers with an entry outside the quantity's range.

    Args:
        name: as `check`.
        values: array of any shape, not empty.
        quantity: as `check`.

    Raises:
        InputError: if an entry is no finite number, or is implausible; the message names the first.
    """
    plausible = QUANTITIES[quantity]
    # Comparisons with NaN are false.
    if plausible.low <= float(values.min()) and float(values.max()) <= plausible.high:
        return
    with np.errstate(all="ignore"):  # Limits may exceed half precision.
        outside = ~((values >= plausible.low) & (values <= plausible.high))
    first = values[outside][0]
    if not np.isfinite(first):
        raise errors.refuse(name, "must be finite", first, "Find where it comes from.")
    check(name, first, quantity)


def check_focal(name: str, value_px: float, width: int) -> None:
    """Refuse a focal length [px] that is implausible for an image of `width` pixels.

    Raises:
        InputError: as `check`.
    """
    _check(name, value_px, QUANTITIES["focal_widths"], scale=width)


def _check(name: str, value: float, plausible: PlausibleRange, *, scale: float) -> None:
    if 0 < plausible.low < 1:
        errors.positive(name, value, plausible.remedy)
    low, high = plausible.low * scale, plausible.high * scale
    errors.in_interval(name, value, low, high, plausible.remedy)
