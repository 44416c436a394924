"""Warnings of settings that a later setting of the same field makes useless."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Sequence
from typing import Any

from starling.sim.sensor import structure
from starling.sim.sensor.sensor import Sensor

_BOTH = "imager."
_STOCK = "matcher.setting"  # It replaces all fields of the matcher.


def spread(path: str) -> tuple[str, ...]:
    """Expand `imager.` to the paths of both imagers."""
    if not path.startswith(_BOTH):
        return (path,)
    rest = path.removeprefix(_BOTH)
    return f"left.{rest}", f"right.{rest}"


def replaced(path: str, later: Iterable[str]) -> bool:
    """Return whether later paths set all that a path sets."""
    folders = ["matcher" if each == _STOCK else each for name in later for each in spread(name)]
    names = [f"{folder}." for folder in folders]
    return all(f"{each}.".startswith(tuple(names)) for each in spread(path)) and bool(names)


def warn_of_edits(paths: Sequence[str]) -> None:
    """Warn of edits, in their order, whose field a later edit sets."""
    lost = [path for number, path in enumerate(paths) if replaced(path, paths[number + 1 :])]
    if lost:
        listed = ", ".join(dict.fromkeys(lost))
        warnings.warn(f"set: {listed} set more than once; the last one wins.", stacklevel=3)


def warn_of_controls(before: Sensor, after: Sensor, paths: Sequence[str]) -> None:
    """Warn of edits of fields that device controls have changed."""
    old, new = (dict(_leaves(structure.to_table(sensor))) for sensor in (before, after))
    changed = [path for path in new if new[path] != old.get(path)]
    both = [path for path in paths if any(replaced(field, [path]) for field in changed)]
    if both:
        listed = ", ".join(dict.fromkeys(both))
        warnings.warn(f"set: {listed} wins over the device preset or emitter.", stacklevel=3)


def _leaves(table: dict[str, Any], folder: str = "") -> Iterable[tuple[str, Any]]:
    for name, value in table.items():
        if isinstance(value, dict):
            yield from _leaves(value, f"{folder}{name}.")
        else:
            yield f"{folder}{name}", value
