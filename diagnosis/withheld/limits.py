"""From which strength on effects are found: what the diagnosis said of its own signatures."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from diagnosis.withheld.catalogue import ROWS
from diagnosis.withheld.errors import refusal
from diagnosis.withheld.nominal import Nominal

# Values below and above the base from which on half of the readings are found, by effect, on scenes
# of development alone: `python -m diagnosis.detection`.
FILE = Path(__file__).with_name("detection.json")
_ADVICE = "Make the file again by python -m diagnosis.detection."


def read(camera: Nominal) -> dict[str, float]:
    """Read the least departure that is found, by effect: to the side where it is found later.

    Infinite where none of an effect's range is found. Choices are left away.

    Args:
        camera: Gives the neutrals.

    Raises:
        WithheldError: if the file is missing or damaged.
    """
    try:
        told: Any = json.loads(FILE.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        rule = "must be a readable JSON file"
        raise refusal("detection limits", rule, FILE, f"{error}. {_ADVICE}") from error
    if not isinstance(told, dict):
        raise refusal("detection limits", "must be a table", type(told).__name__, _ADVICE)
    found = {}
    for name, sides in told.items():
        row = ROWS.get(name)
        if row is None or row.scale == "choice":
            continue
        if not isinstance(sides, list) or len(sides) != 2:
            raise refusal(f"limit of {name}", "must have two sides", sides, _ADVICE)
        known = [side for side in sides if side is not None]
        if not all(isinstance(side, int | float) for side in known):
            raise refusal(f"limit of {name}", "must be numbers", sides, _ADVICE)
        departures = (row.departure(camera, float(side)) for side in known)
        found[name] = max(departures, default=float("inf"))
    return found
