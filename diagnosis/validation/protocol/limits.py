"""Detection limits of effects, measured by the diagnosis on its own simulated responses."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from starling.diagnosis.validation.camera import json_file
from starling.diagnosis.validation.camera.catalogue import ROWS, EffectRow
from starling.diagnosis.validation.camera.errors import refusal
from starling.diagnosis.validation.camera.nominal import Nominal

# By effect, the values below and above the base at which half of the cases are detected, or the
# detectable choices. Measured on development scenes by
# `python -m starling.diagnosis.validation.adapters detection`.
FILE = Path(__file__).with_name("detection.json")
# The same for effects on the images, despite an imperfect base (`--despite-gaps`).
IMPERFECT_FILE = Path(__file__).with_name("detection_imperfect.json")
_ADVICE = "Write it again with python -m starling.diagnosis.validation.adapters detection."


@dataclass(frozen=True, kw_only=True, slots=True)
class DetectionLimits:
    """Detection limits of effects."""

    # Least detectable departure by effect and sign; infinite if none in the range is detectable.
    departures: Mapping[tuple[str, int], float] = field(default_factory=dict)
    # Detectable values by effect of scale `choice`.
    choices: Mapping[str, tuple[float, ...]] = field(default_factory=dict)

    def least(self, row: EffectRow, sign: int) -> float:
        """Return the detection limit on one side, or the low end of the range if none was measured.

        No limit is measured for effects outside the table of the diagnosis.
        """
        return self.departures.get((row.name, sign), row.low)

    def and_limits(self, second: DetectionLimits) -> DetectionLimits:
        """Return the limits that hold on this base and on a second one, where both have any."""
        departures = {
            key: max(least, second.departures.get(key, least))
            for key, least in self.departures.items()
        }
        choices = {
            name: tuple(value for value in values if value in second.choices.get(name, values))
            for name, values in self.choices.items()
        }
        return DetectionLimits(departures=departures, choices=choices)

    def sides(self, row: EffectRow, camera: Nominal) -> list[int]:
        """Return the signs on which this camera allows a detectable departure."""
        room = {sign: row.reach(camera, sign) for sign in row.signs}
        return [sign for sign, most in room.items() if 0 < most >= self.least(row, sign)]


def read(file: Path | None = None, *, required: Collection[str] = ()) -> DetectionLimits:
    """Read detection limits.

    Limits are departures from the camera they were measured with, so they apply to another camera.

    Args:
        file: File of another camera or other scenes; None reads the file of this package.
        required: Names of effects that the file must hold. Effects outside the table are exempt.

    Raises:
        WithheldError: if the file is missing or damaged, or lacks a required effect.
    """
    file = file or FILE
    table = json_file.read(file, "detection limits", _ADVICE)
    if not isinstance(table, dict):
        raise refusal("detection limits", "must be a table", type(table).__name__, _ADVICE)
    missing = sorted(
        name for name in required if ROWS[name].kind != "outside" and name not in table
    )
    if missing:
        rule = "must hold all effects that are drawn"
        raise refusal("detection limits", rule, f"{file} without {missing}", _ADVICE)
    departures: dict[tuple[str, int], float] = {}
    choices = {}
    for name, limit in table.items():
        row = ROWS.get(name)
        if row is None:
            continue
        if row.scale == "choice":
            choices[name] = _choices(row, limit)
        else:
            departures |= {(name, sign): _departure(row, limit, sign) for sign in row.signs}
    return DetectionLimits(departures=departures, choices=choices)


def _departure(row: EffectRow, limit: Any, sign: int) -> float:
    sides = ("below", "above")
    if not isinstance(limit, dict) or not {"base", *sides} <= limit.keys():
        raise refusal(f"limit of {row.name}", "must have a base and two sides", limit, _ADVICE)
    known = [limit[side] for side in sides if limit[side] is not None]
    numbers = (limit["base"], *known)
    if not all(isinstance(number, int | float) and math.isfinite(number) for number in numbers):
        raise refusal(f"limit of {row.name}", "must be numbers", limit, _ADVICE)
    if row.scale == "ratio" and min(numbers) <= 0:
        raise refusal(f"limit of {row.name}", "must be numbers above zero", limit, _ADVICE)
    base = float(limit["base"])
    side = limit["below" if sign < 0 else "above"]
    least = float("inf") if side is None else row.departure_from(base, float(side))
    # Noise does not hide effects on a finished depth map, so the low end of the page is the limit.
    return max(least, row.low) if row.kind == "post" else least


def _choices(row: EffectRow, limit: Any) -> tuple[float, ...]:
    """Detectable choices of an effect; all of them if the file lists words in place of numbers."""
    detectable = limit.get("found") if isinstance(limit, dict) else None
    if not isinstance(detectable, list):
        raise refusal(f"limit of {row.name}", "must be a list of choices", limit, _ADVICE)
    if any(isinstance(choice, str) for choice in detectable):
        return row.choices
    return tuple(choice for choice in row.choices if choice in detectable)
