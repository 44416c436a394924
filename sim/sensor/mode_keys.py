"""Keys of a sensor that hold in single modes of a camera."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from typing import Any

from starling.patterns import errors
from starling.sim.sensor import scaling, structure
from starling.sim.sensor.modes import ChosenMode, Modes
from starling.sim.sensor.sensor import Sensor

_WHOLE = frozenset({"kind", "setting"})  # A table with such a key replaces a part.


def filled(known: Modes, chosen: ChosenMode | None, sensor: Sensor) -> Modes:
    """Give every mode a value of each key that any mode has: the sensor's in that mode.

    Without it, a key of a mode would stay when the camera leaves the mode.

    Args:
        known: modes of the camera.
        chosen: mode of the sensor, None if unknown.
        sensor: sensor whose keys the modes change.
    """
    union: dict[str, Any] = {}
    for mode in known.values():
        union = structure.merged(union, nested(mode.changes))
    if chosen is None or not union:
        return known
    result = {}
    for name, mode in known.items():
        ratio = mode.scale / known[chosen.mode].scale
        same = scaling.scaled(sensor, ratio, mode.width, mode.height)
        values = _values(union, structure.to_table(same))
        result[name] = dataclasses.replace(mode, changes=structure.merged(values, mode.changes))
    return result


def without(known: Modes, keys: Mapping[str, Any]) -> Modes:
    """Drop keys from all modes, because a file sets them for all."""
    dropped = nested(keys)
    return {
        name: dataclasses.replace(mode, changes=_without(nested(mode.changes), dropped))
        for name, mode in known.items()
    }


def nested(table: Mapping[str, Any]) -> dict[str, Any]:
    """Expand dotted keys to nested tables.

    Example:
        >>> nested({"matcher": {"refinement.median_px": 5}})
        {'matcher': {'refinement': {'median_px': 5}}}
    """
    result: dict[str, Any] = {}
    for path, value in table.items():
        inner = nested(value) if isinstance(value, Mapping) else value
        for name in reversed(path.split(".")[1:]):
            inner = {name: inner}
        result = structure.merged(result, {path.partition(".")[0]: inner})
    return result


def paths(table: Mapping[str, Any], folder: str = "") -> Iterator[str]:
    """List the dotted paths of all values and tables in nested tables."""
    for key, value in nested(table).items():
        yield f"{folder}{key}"
        if isinstance(value, Mapping):
            yield from paths(value, f"{folder}{key}.")


def refuse_twice(table: Mapping[str, Any], name: str) -> None:
    """Refuse a key that a table gives twice: as `"a.b" = 1` and as `a.b = 2`.

    Raises:
        InputError: if it does; the message names the table.
    """
    seen: set[str] = set()
    for path in _leaves(table):
        if path in seen:
            raise errors.refuse(f"{path}{name}", "must be given once", "two values", "Drop one.")
        seen.add(path)


def _leaves(table: Mapping[str, Any], folder: str = "") -> Iterator[str]:
    for key, value in table.items():
        if isinstance(value, Mapping):
            yield from _leaves(value, f"{folder}{key}.")
        else:
            yield f"{folder}{key}"


def _values(keys: Mapping[str, Any], table: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values of a table at the given keys."""
    result = {}
    for key, value in keys.items():
        old = table.get(key)
        if isinstance(value, Mapping) and isinstance(old, Mapping) and not _WHOLE & value.keys():
            result[key] = _values(value, old)
        elif key in table:
            result[key] = old
    return result


def _without(changes: Mapping[str, Any], keys: Mapping[str, Any]) -> dict[str, Any]:
    result = {}
    for name, value in changes.items():
        key = keys.get(name)
        if name not in keys:
            result[name] = value
        elif isinstance(value, Mapping) and isinstance(key, Mapping) and not _WHOLE & key.keys():
            rest = _without(value, key)
            if rest:
                result[name] = rest
    return result
