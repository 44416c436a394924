"""Board files of depthai: fields of view [deg] and translations [cm] of the cameras.

Source: luxonis/depthai-boards, `boards/*.json`. Centimetres: `specTranslation` of the OAK-D is
-7.5 for its 75 mm.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from starling.patterns import errors
from starling.sim.sensor.intrinsics.calibration import DeviceCalibration

_CM = 0.01  # [m]
_EXAMPLE = "Give a file of luxonis/depthai-boards."
_Place = tuple[float, float, float]


def parse(value: Any, path: Path) -> DeviceCalibration:
    """Read field of view and baseline of the stereo pair.

    Raises:
        InputError: if a key is missing, or the pair's cameras are not connected.
    """
    board = _table(value, "board_config", path)
    cameras = _table(board, "cameras", path)
    pair = _table(board, "stereo_config", path)
    left, right = (str(pair.get(key, "")) for key in ("left_cam", "right_cam"))
    field_deg = _table(cameras, left, path).get("hfov")
    if not errors.is_number(field_deg):
        raise errors.refuse(f"{left}.hfov in {path.name}", "must be given", field_deg, _EXAMPLE)
    places = _places(cameras, left, path)
    if right not in places:
        rule, got = f"must place {right or 'right_cam'} from {left}", ", ".join(places)
        raise errors.refuse(f"extrinsics in {path.name}", rule, got, _EXAMPLE)
    baseline_m = math.hypot(*places[right]) * _CM
    return DeviceCalibration(
        path=path, cameras=(), field_deg=float(field_deg), baseline_m=baseline_m
    )


def _places(cameras: Mapping[str, Any], start: str, path: Path) -> dict[str, _Place]:
    """Return the places [cm] of all cameras that are connected with the start."""
    steps: list[tuple[str, str, _Place]] = []
    for name in cameras:
        extrinsics = _table(cameras, name, path).get("extrinsics")
        if isinstance(extrinsics, Mapping):
            step = _place(extrinsics.get("specTranslation"), name, path)
            goal = str(extrinsics.get("to_cam"))
            steps += [(name, goal, step), (goal, name, (-step[0], -step[1], -step[2]))]
    places: dict[str, _Place] = {start: (0.0, 0.0, 0.0)}
    for _ in cameras:
        for near, far, step in steps:
            if near in places and far not in places:
                x, y, z = places[near]
                places[far] = (x + step[0], y + step[1], z + step[2])
    return places


def _place(table: Any, name: str, path: Path) -> _Place:
    values = [table.get(axis) if isinstance(table, Mapping) else None for axis in "xyz"]
    if not all(errors.is_number(value) for value in values):
        rule = "must have numbers x, y, z"
        raise errors.refuse(f"{name}.specTranslation in {path.name}", rule, table, _EXAMPLE)
    x, y, z = (float(value) for value in values if errors.is_number(value))
    return x, y, z


def _table(value: Any, key: str, path: Path) -> Mapping[str, Any]:
    table = value.get(key) if isinstance(value, Mapping) else None
    if not isinstance(table, Mapping):
        raise errors.refuse(
            f"{key or 'left_cam'} in {path.name}", "must be a table", table, _EXAMPLE
        )
    return table
