"""Board files of depthai: fields of view [deg] and translations [cm] of the cameras.

Source: luxonis/depthai-boards, `boards/*.json`. Centimetres: `specTranslation` of the OAK-D is
-7.5 for its 75 mm.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from starling.patterns import errors
from starling.sim.sensor.intrinsics.calibration import DeviceCalibration

_CM = 0.01  # [m]
_EXAMPLE = "Give a file of luxonis/depthai-boards."
_Place = tuple[float, float, float]
Link = tuple[str, str, _Place]  # Camera, connected camera, and translation [cm].


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
    baseline_m = distance_m(_links(cameras, path), left, right or "right_cam", path)
    return DeviceCalibration(
        path=path, cameras=(), field_deg=float(field_deg), baseline_m=baseline_m
    )


def distance_m(links: Sequence[Link], left: str, right: str, path: Path) -> float:
    """Return the distance of two cameras [m], over chains of links [cm].

    Raises:
        InputError: if no chain connects them.
    """
    reversed_links = [(goal, start, (-x, -y, -z)) for start, goal, (x, y, z) in links]
    places: dict[str, _Place] = {left: (0.0, 0.0, 0.0)}
    for _ in links:
        for near, far, step in (*links, *reversed_links):
            if near in places and far not in places:
                x, y, z = places[near]
                places[far] = (x + step[0], y + step[1], z + step[2])
    if right not in places:
        rule, got = f"must place {right} from {left}", ", ".join(places)
        raise errors.refuse(f"extrinsics in {path.name}", rule, got, _EXAMPLE)
    return math.hypot(*places[right]) * _CM


def step_cm(table: Any, name: str, advice: str) -> _Place:
    """Return a translation, or refuse it."""
    values = [table.get(axis) if isinstance(table, Mapping) else None for axis in "xyz"]
    if not all(errors.is_number(value) for value in values):
        raise errors.refuse(name, "must have numbers x, y, z", table, advice)
    x, y, z = (float(value) for value in values if errors.is_number(value))
    return x, y, z


def _links(cameras: Mapping[str, Any], path: Path) -> list[Link]:
    links = []
    for name in cameras:
        extrinsics = _table(cameras, name, path).get("extrinsics")
        if isinstance(extrinsics, Mapping):
            place = f"{name}.specTranslation in {path.name}"
            step = step_cm(extrinsics.get("specTranslation"), place, _EXAMPLE)
            links.append((name, str(extrinsics.get("to_cam")), step))
    return links


def _table(value: Any, key: str, path: Path) -> Mapping[str, Any]:
    table = value.get(key) if isinstance(value, Mapping) else None
    if not isinstance(table, Mapping):
        raise errors.refuse(
            f"{key or 'left_cam'} in {path.name}", "must be a table", table, _EXAMPLE
        )
    return table
