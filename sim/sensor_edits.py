"""The sensor that a command asks for: a preset, the captures' geometry, edits as text."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable
from typing import Any

from patterns import errors
from sim import capture, matcher, sensors, structure
from sim.sensor import Sensor

_BARE_WORD = re.compile(r"[A-Za-z_][\w./-]*")


def asked_for(name: str, captures: str, edits: Iterable[str]) -> Sensor:
    """Load a sensor, give it the geometry of the captures it is used on, then apply edits.

    Args:
        name: preset or sensor file.
        captures: what it is used on; only a capture set or a scene in it has a geometry.
        edits: see `apply`.

    Raises:
        InputError: whatever is refused on the way.
    """
    sensor = sensors.load(name)
    if capture.is_capture(captures):
        sensor = capture.open_set(captures).info.geometry_into(sensor)
    return apply(sensor, edits)


def apply(sensor: Sensor, edits: Iterable[str]) -> Sensor:
    """Apply edits in order; only what comes out at the end must be a possible sensor.

    Args:
        sensor: what to edit.
        edits: `PATH=VALUE` each: a dotted path to a field and a TOML value (a bare word is text).
            `imager.X` edits both imagers; `matcher.setting` takes a stock setting by its name.

    Raises:
        InputError: an edit that is no `PATH=VALUE`, an unknown path, or a refused value.

    Example:
        >>> apply(sensors.load("d435"), ["projector.power_w=0.2"]).projector.power_w
        0.2
    """
    table = structure.to_table(sensor)
    for edit in edits:
        path, value = _parse(edit)
        if path == "matcher.setting":
            table["matcher"] = structure.to_table(matcher.named(value))
        elif path.startswith("imager."):
            for side in ("left", "right"):
                _set(table, side + path.removeprefix("imager"), value)
        else:
            _set(table, path, value)
    return structure.from_table(Sensor, table)


def _set(table: dict[str, Any], path: str, value: Any) -> None:
    """Set one key; unknown keys are refused with the whole table."""
    *folders, last = path.split(".")
    for depth, name in enumerate(folders, 1):
        table = table.setdefault(name, {})
        if not isinstance(table, dict):
            rest = ".".join([*folders[depth:], last])
            raise errors.refuse(
                ".".join(folders[:depth]), "has no fields", f".{rest}", "Drop the last part."
            )
    table[last] = value


def _parse(edit: str) -> tuple[str, Any]:
    path, equals, text = (part.strip() for part in edit.partition("="))
    if not (path and equals and text):
        raise errors.refuse(
            "--set", "must be PATH=VALUE", repr(edit), "Example: --set projector.power_w=0.2."
        )
    try:
        table = tomllib.loads(f"value = {text}")
    except (ValueError, RecursionError):
        if _BARE_WORD.fullmatch(text):  # The shell has eaten the quotes.
            return path, text
        table = {}
    if list(table) != ["value"]:
        raise errors.refuse(f"--set {path}", "must be a TOML value", repr(text), "Quote text.")
    return path, table["value"]
