"""Selection of scenes of a capture set for benchmarks."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

from starling.sim.captures import capture
from starling.sim.captures.capture import CapturedScene


def first_of_each(path: Path, rooms: Collection[str] = ()) -> dict[str, CapturedScene]:
    """Return the first scene of each room, in the order of the set; no names select all rooms."""
    first: dict[str, CapturedScene] = {}
    for scene in capture.open_set(path).scenes:
        if not rooms or scene.room in rooms:
            first.setdefault(scene.room, scene)
    return first
