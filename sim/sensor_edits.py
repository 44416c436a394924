"""Edits of a sensor as text: `projector.power_w=0.2`."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable
from typing import Any

from patterns import errors
from sim import matcher, structure
from sim.sensor import Sensor

_BARE_WORD = re.compile(r"[A-Za-z_][\w./-]*")


def apply(sensor: Sensor, edits: Iterable[str]) -> Sensor:
    """Apply edits in order.

    Args:
        sensor: what to edit.
        edits: `PATH=VALUE` each: a dotted path to a field and a TOML value (a bare word is text).
            `imager.X` edits both imagers; `matcher.setting` takes a stock setting by its name.

    Raises:
        InputError: an edit that is no `PATH=VALUE`, an unknown path, or a refused value.

    Example:
        >>> from sim import sensors
        >>> apply(sensors.load("d435"), ["projector.power_w=0.2"]).projector.power_w
        0.2
    """
    for edit in edits:
        path, value = _parse(edit)
        if path == "matcher.setting":
            sensor = structure.edit(sensor, "matcher", structure.to_table(matcher.named(value)))
        elif path.startswith("imager."):
            for side in ("left", "right"):
                sensor = structure.edit(sensor, side + path.removeprefix("imager"), value)
        else:
            sensor = structure.edit(sensor, path, value)
    return sensor


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
