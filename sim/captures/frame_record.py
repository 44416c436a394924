"""`frame.json`: the record of one frame, with its known keys checked and others preserved."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from starling.patterns import errors
from starling.sim import files, quantities
from starling.sim.geometry import frames

FILE = "frame.json"

_POSE_ROUNDING = 1e-3  # Tolerance of rotations; trajectories are often rounded.
# Quantities of known keys; null counts as absent.
_NUMBERS = {
    "timestamp": "time_s",
    "exposure_s": "exposure_s",
    "gain": "gain",
    "laser_power": "laser_power",
}


def parse(data: bytes, path: Path) -> dict[str, Any]:
    """Parse and check a record.

    A pose that is not finite is removed with a warning: tracking was lost in this frame.

    Args:
        data: content of the file; a byte order mark is allowed.
        path: name of the file in error messages.

    Raises:
        InputError: if the content is no JSON object, or a known key has an impossible value.
    """
    record = files.parse_json(data, path)
    if not isinstance(record, dict):
        raise errors.refuse(FILE, "must be one object", path, "Write {...}.")
    with errors.naming(path):
        return _checked(record, path)


def _checked(record: dict[str, Any], path: Path) -> dict[str, Any]:
    record = {key: value for key, value in record.items() if value is not None}
    for key, quantity in _NUMBERS.items():
        if key in record:
            quantities.check(key, record[key], quantity)
    if not isinstance(record.get("counts", ""), str):
        raise errors.refuse("counts", "must be a text", repr(record["counts"]), "As 'repeats'.")
    if "left_from_world" in record:
        pose = _matrix("left_from_world", record["left_from_world"])
        if np.isfinite(pose).all():
            frames.refuse_not_rigid("left_from_world", pose, rounding=_POSE_ROUNDING)
        else:
            warnings.warn(f"{path}: left_from_world is not finite; no pose is used.", stacklevel=2)
            del record["left_from_world"]
    bodies = _texts("bodies", record.get("bodies", []))
    for number, shown in enumerate(_tables("objects", record.get("objects", []))):
        _check_object(f"objects[{number}]", shown, bodies)
    return record


def _check_object(name: str, shown: Mapping[str, Any], bodies: list[str]) -> None:
    for key in ("mesh", "body"):
        if not isinstance(shown.get(key), str) or not shown[key]:
            raise errors.refuse(f"{name}.{key}", "must be a text", repr(shown.get(key)), "Name it.")
    if Path(shown["mesh"]).is_absolute() or ".." in Path(shown["mesh"]).parts:
        advice = "Give its path inside the folder of meshes."
        raise errors.refuse(f"{name}.mesh", "must be a relative path", shown["mesh"], advice)
    if shown["body"] not in bodies:
        raise errors.refuse(f"{name}.body", "must be in bodies", shown["body"], "List it there.")
    pose = _matrix(f"{name}.left_from_mesh", shown.get("left_from_mesh"))
    frames.refuse_not_rigid(f"{name}.left_from_mesh", pose, rounding=_POSE_ROUNDING)


def _matrix(name: str, value: Any) -> frames.Pose:
    """Convert four rows of four numbers; NaN is allowed."""
    rows = value if isinstance(value, list) else []
    numbers = [entry for row in rows for entry in (row if isinstance(row, list) else [None])]
    regular = [len(row) for row in rows if isinstance(row, list)] == [4, 4, 4, 4]
    plain = [n for n in numbers if isinstance(n, (int, float)) and not isinstance(n, bool)]
    if not regular or len(plain) < len(numbers) or any(abs(n) > 1e300 for n in plain):
        raise errors.refuse(name, "must be four rows of four numbers", repr(value)[:80], "[R t].")
    return np.array(value, np.float64)


def _texts(name: str, value: Any) -> list[str]:
    if not isinstance(value, list) or not all(isinstance(item, str) for item in value):
        raise errors.refuse(name, "must be a list of texts", repr(value)[:80], "Give [] for none.")
    return value


def _tables(name: str, value: Any) -> list[dict[str, Any]]:
    if not isinstance(value, list) or not all(isinstance(item, dict) for item in value):
        raise errors.refuse(name, "must be a list of objects", repr(value)[:80], "Give [].")
    return value
