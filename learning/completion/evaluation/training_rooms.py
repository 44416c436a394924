"""Rooms that a method is judged in and has learnt from, which flatter it."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from starling.sim.console.output import RECORD

VERB = "train completion"


def learnt_from(word: str, captures: str, rooms: Sequence[str]) -> list[str]:
    """Rooms of a capture set that a method has learnt from, as far as its folder tells.

    Args:
        word: the method, as `methods.asked` takes it.
        captures: the set that it is judged on.
        rooms: that are judged.
    """
    weights = word.partition("=")[2]
    if not weights:
        return []
    folder = Path(weights)
    told = _record(folder / RECORD) or _record(folder.parent / RECORD)  # `weights` lie in one.
    arguments = told.get("arguments", {}) if told.get("verb") == VERB else {}
    also = [one.partition("=")[2] for one in arguments.get("also", [])]
    places = [Path(place).resolve() for place in (arguments.get("captures", ""), *also)]
    if Path(captures).resolve() not in places:
        return []
    own = arguments.get("rooms")
    return [room for room in rooms if own is None or room in own]


def _record(path: Path) -> dict[str, Any]:
    """What a verb has left; nothing where it has left none."""
    try:
        told = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return told if isinstance(told, dict) else {}
