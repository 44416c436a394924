"""Reading of the RealSense viewer's JSON export of advanced-mode settings.

Two forms are in use: a flat table of controls, and in newer viewers
`{"schema version": 1, "device": {...}, "parameters": {...}, "viewer": {...}}`. Values are text
or numbers. Source of names: librealsense's json_loader.hpp and files exported by the viewer.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from starling.patterns import errors
from starling.sim.sensor.realsense import controls
from starling.sim.sensor.realsense.controls import Control

_SECTIONS = ("schema version", "device", "parameters", "viewer")
PRODUCT_LINE = "D400"


def read(path: str | Path) -> dict[str, Control]:
    """Read an exported file.

    Args:
        path: JSON file.

    Returns:
        Values by the controls' canonical names.

    Raises:
        InputError: for an unreadable file, a file without a JSON table, another product line, or a
            control that `starling.sim.sensor.realsense.controls.canonical` refuses.
    """
    try:
        table = json.loads(Path(path).read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise errors.refuse(
            "device preset", "must be a readable file", path, f"{error.strerror}."
        ) from None
    except (ValueError, RecursionError):
        raise errors.refuse(
            "device preset", "must be a JSON file", path, "Export it from the RealSense viewer."
        ) from None
    if not isinstance(table, Mapping):
        raise errors.refuse(
            "device preset", "must hold a table", f"{type(table).__name__} in {path}", _EXAMPLE
        )
    return controls.canonical(_entries(table))


_EXAMPLE = 'Write {"param-leftrightthreshold": 24, ...}.'


def _entries(table: Mapping[str, Any]) -> list[tuple[str, Any]]:
    """List all controls of either form."""
    if "parameters" not in table:
        return list(table.items())
    for name in table:
        errors.one_of("section", name, _SECTIONS)
    device = _section(table, "device")
    line = device.get("product line", PRODUCT_LINE)
    if line != PRODUCT_LINE:
        raise errors.refuse(
            "device.product line", f"must be {PRODUCT_LINE}", repr(line), "Others are not modelled."
        )
    return [*_section(table, "parameters").items(), *_section(table, "viewer").items()]


def _section(table: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    section = table.get(name, {})
    if not isinstance(section, Mapping):
        raise errors.refuse(name, "must be a table", repr(section), _EXAMPLE)
    return section
