"""From which strength on effects are found: what the diagnosis said of its own signatures."""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from starling.diagnosis.validation.camera.catalogue import ROWS, Row
from starling.diagnosis.validation.camera.errors import refusal
from starling.diagnosis.validation.camera.nominal import Nominal

# Values below and above the base from which on half of the readings are found, or the choices that
# are, by effect, on scenes of development alone: `python -m starling.diagnosis.validation.adapters.detection`.
FILE = Path(__file__).with_name("detection.json")
_ADVICE = "Make the file again by python -m starling.diagnosis.validation.adapters.detection."


@dataclass(frozen=True, kw_only=True, slots=True)
class Limits:
    """What is found."""

    # By effect and sign, the least departure; infinite where none of the range there is found.
    departures: Mapping[tuple[str, int], float]
    choices: Mapping[str, tuple[float, ...]]  # By effect that is a choice.

    def least(self, row: Row, sign: int) -> float:
        """Least departure to one side that is found; the table's low end where nobody asked, as of
        what is in no table of the diagnosis.
        """
        return self.departures.get((row.name, sign), row.low)

    def sides(self, row: Row, camera: Nominal) -> list[int]:
        """Signs to which a camera leaves room for a departure that is found there."""
        room = {sign: row.reach(camera, sign) for sign in row.signs}
        return [sign for sign, most in room.items() if 0 < most >= self.least(row, sign)]


def read(file: Path | None = None, *, of: Collection[str] = ()) -> Limits:
    """Read from which departure on effects are found, and which choices are.

    Departures are from the camera that the limits were made with: they hold for another one.

    Args:
        file: Of another camera or other scenes; None takes this package's.
        of: Names of effects that are drawn by these limits, so that the file must hold them; of
            those outside the table nobody can ask.

    Raises:
        WithheldError: if the file is missing or damaged, or lacks an effect.
    """
    file = file or FILE
    try:
        told: Any = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        rule = "must be a readable JSON file"
        raise refusal("detection limits", rule, file, f"{error}. {_ADVICE}") from error
    if not isinstance(told, dict):
        raise refusal("detection limits", "must be a table", type(told).__name__, _ADVICE)
    lacking = sorted(name for name in of if ROWS[name].kind != "outside" and name not in told)
    if lacking:
        rule = "must hold all effects that are drawn"
        raise refusal("detection limits", rule, f"{file} without {lacking}", _ADVICE)
    departures: dict[tuple[str, int], float] = {}
    choices = {}
    for name, limit in told.items():
        row = ROWS.get(name)
        if row is None:
            continue
        if row.scale == "choice":
            choices[name] = _choices(row, limit)
        else:
            departures |= {(name, sign): _departure(row, limit, sign) for sign in row.signs}
    return Limits(departures=departures, choices=choices)


def _departure(row: Row, told: Any, sign: int) -> float:
    sides = ("below", "above")
    if not isinstance(told, dict) or not {"base", *sides} <= told.keys():
        raise refusal(f"limit of {row.name}", "must have a base and two sides", told, _ADVICE)
    known = [told[side] for side in sides if told[side] is not None]
    if not all(isinstance(number, int | float) for number in (told["base"], *known)):
        raise refusal(f"limit of {row.name}", "must be numbers", told, _ADVICE)
    base = float(told["base"])
    side = told["below" if sign < 0 else "above"]
    least = float("inf") if side is None else row.apart(base, float(side))
    # No noise hides what acts on a map that is there: as weak as its page has it, and no weaker.
    return max(least, row.low) if row.kind == "post" else least


def _choices(row: Row, told: Any) -> tuple[float, ...]:
    """Those of a row's that are found; of words, whose numbers are a page's own, all if any is."""
    found = told.get("found") if isinstance(told, dict) else None
    if not isinstance(found, list):
        raise refusal(f"limit of {row.name}", "must be a list of choices", told, _ADVICE)
    if any(isinstance(one, str) for one in found):
        return row.choices
    return tuple(one for one in row.choices if one in found)
