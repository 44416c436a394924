"""Detection of evaluated rooms that a method was trained on, where the results are too good."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from starling.sim.console.output import RECORD

VERB = "train completion"


def training_rooms(specifier: str, captures: str, rooms: Sequence[str]) -> list[str]:
    """Return the rooms of a capture set that a method was trained on, according to its folder.

    Args:
        specifier: the method, see `methods.create`.
        captures: the evaluated set.
        rooms: the evaluated rooms.
    """
    weights = specifier.partition("=")[2]
    if not weights:
        return []
    folder = Path(weights)
    record = _record(folder / RECORD) or _record(folder.parent / RECORD)  # The folder `weights`.
    arguments = record.get("arguments", {}) if record.get("verb") == VERB else {}
    also = [data_set.partition("=")[2] for data_set in arguments.get("also", [])]
    places = [Path(place).resolve() for place in (arguments.get("captures", ""), *also)]
    if Path(captures).resolve() not in places:
        return []
    trained_rooms = arguments.get("rooms")
    return [room for room in rooms if trained_rooms is None or room in trained_rooms]


def _record(path: Path) -> dict[str, Any]:
    """Read the record of a verb; empty if there is none."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return content if isinstance(content, dict) else {}
