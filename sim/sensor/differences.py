"""A sensor as differences from a base: the text of a sensor file."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import tomli_w

from starling.sim.sensor import mode_keys, structure
from starling.sim.sensor.sensor import Sensor
from starling.sim.sensor.sensor_file import SensorFile


def differences(base: SensorFile, sensor: Sensor) -> dict[str, Any]:
    """Return the keys of a sensor file on a base, whose other keys are the base's."""
    old, new = structure.to_table(base.sensor), structure.to_table(sensor)
    keys = _changes(old, new)
    if base.own_right:
        return keys
    # Without `right` the file copies its left imager.
    keys.pop("right", None)
    if new["right"] != new["left"]:
        keys["right"] = _changes(old["right"], new["right"])
    return keys


def changed_paths(base: SensorFile, sensor: Sensor) -> list[str]:
    """List the dotted paths of fields that differ from the base's."""
    keys = differences(base, sensor)
    return [path for path in mode_keys.paths(keys) if not _is_table(keys, path)]


def new_file(name: str, base_name: str, base: SensorFile, sensor: Sensor, mode: str = "") -> str:
    """Return the text of a sensor file that inherits from a base.

    Args:
        name: name of the new sensor.
        base_name: preset, or path of the base.
        base: base in the mode of the new file.
        sensor: sensor that the file describes.
        mode: mode of the new file, if it is not the base's.
    """
    if base_name.endswith(".toml"):  # The text can be saved in any folder.
        base_name = os.path.abspath(Path(base_name))
    table: dict[str, Any] = {"base": base_name, "name": name}
    if mode:
        table["mode"] = mode
    return tomli_w.dumps(table | differences(base, sensor) | {"name": name})


def _changes(old: Mapping[str, Any], new: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values of a table that differ; a part of another kind is whole."""
    changes = {}
    for key, value in new.items():
        before = old.get(key)
        if isinstance(value, Mapping) and isinstance(before, Mapping):
            if value.get("kind") != before.get("kind"):
                changes[key] = dict(value)
            elif inner := _changes(before, value):
                changes[key] = inner
        elif value != before:
            changes[key] = value
    return changes


def _is_table(keys: Mapping[str, Any], path: str) -> bool:
    value: Any = keys
    for name in path.split("."):
        value = value[name]
    return isinstance(value, Mapping) and bool(value)
