"""Sensors from tables of a sensor file, and changes of a sensor by such tables."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from starling.patterns import errors
from starling.sim.sensor import matcher, structure
from starling.sim.sensor.sensor import Sensor


def from_table(table: Mapping[str, Any]) -> Sensor:
    """Build a sensor from its tables. A missing `right` is a copy of `left`.

    `matcher.setting` names a stock setting (see `starling.sim.sensor.matcher.named`). The other
    keys of the table edit it, as tables or by dotted path. A table with a `kind` replaces a part.
    """
    structure.refuse_long_integers(table, "sensor")
    table = dict(table)
    if "left" in table and "right" not in table:
        table["right"] = table["left"]
    if isinstance(table.get("matcher"), Mapping):
        table["matcher"] = _matcher(table["matcher"])
    return structure.from_table(Sensor, table)


def changed(sensor: Sensor, changes: Mapping[str, Any], *, own_right: bool) -> Sensor:
    """Return a sensor with changed keys, written as in a file.

    Args:
        sensor: sensor to change.
        changes: tables. `matcher.setting` replaces the matcher.
        own_right: whether the right imager is its own, and not a copy of the left one.

    Raises:
        InputError: as `from_table`, or for a pattern when all emitters have their own.
    """
    if not changes:
        return sensor
    structure.refuse_long_integers(changes, "sensor")
    table, changes = structure.to_table(sensor), dict(changes)
    part = changes.get("matcher")
    if isinstance(part, Mapping) and "setting" in part:
        table["matcher"] = changes["matcher"] = _matcher(part)
    table = structure.merged(table, changes)
    if not own_right and "right" not in changes:
        table["right"] = table["left"]
    result = structure.from_table(Sensor, table)
    _refuse_hidden_pattern(result, changes.get("projector"))
    return result


def with_absolute_patterns(sensor: Sensor, folder: str | Path) -> Sensor:
    """Make the paths of pattern images absolute; a pattern name with a suffix is a file."""
    projector = sensor.projector

    def full(name: str) -> str:
        return os.path.abspath(Path(folder) / name) if Path(name).suffix else name

    emitters = tuple(
        dataclasses.replace(emitter, pattern=full(emitter.pattern))
        for emitter in projector.emitters
    )
    projector = dataclasses.replace(projector, pattern=full(projector.pattern), emitters=emitters)
    return dataclasses.replace(sensor, projector=projector)


def _matcher(changes: Mapping[str, Any]) -> dict[str, Any]:
    """Replace `setting` by the fields of the stock setting, below the other changes."""
    if "setting" not in changes:
        return dict(changes)
    stock = structure.to_table(matcher.named(changes["setting"]))
    rest = {path: value for path, value in changes.items() if path != "setting"}
    return structure.merged(stock, rest)


def _refuse_hidden_pattern(sensor: Sensor, keys: Any) -> None:
    """Refuse a pattern without effect because all emitters of the base have their own."""
    emitters = sensor.projector.emitters
    if not isinstance(keys, Mapping) or "pattern" not in keys or "emitters" in keys:
        return
    if emitters and all(emitter.pattern for emitter in emitters):
        rule, got = "must not be set where every emitter has its own", repr(keys["pattern"])
        raise errors.refuse("projector.pattern", rule, got, "Set projector.emitters = [] too.")
