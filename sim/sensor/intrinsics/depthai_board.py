"""Board files of depthai: fields of view [deg] and translations [cm] of the cameras.

Source: luxonis/depthai-boards, `boards/*.json`. Centimetres: `specTranslation` of the OAK-D is
-7.5 for its 75 mm.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from starling.patterns import errors
from starling.sim.sensor.intrinsics.calibration import DeviceCalibration, baseline_of

_CM = 0.01  # [m]
_LARGEST = 1e4  # Largest number of a place [cm] or rotation [deg].
_TURNED_DEG = 1.0  # Largest rotation of parallel cameras.
_ROUNDING_CM = 0.5  # Largest distance of two ways to one camera.
_EXAMPLE = "Give a file of luxonis/depthai-boards."
_Place = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Link:
    """Translation [cm] from a camera to another."""

    near: str
    far: str
    step: _Place
    turned: bool = False  # Whether the cameras are not parallel.

    def reversed(self) -> Link:
        """Return the link from the other camera."""
        x, y, z = self.step
        return Link(self.far, self.near, (-x, -y, -z), turned=self.turned)

    def from_place(self, place: _Place) -> _Place:
        """Return the place of the far camera for one of the near camera."""
        return place[0] + self.step[0], place[1] + self.step[1], place[2] + self.step[2]


def parse(value: Any, path: Path) -> DeviceCalibration:
    """Read field of view and baseline of the stereo pair.

    Raises:
        InputError: if a key is missing, or as `distance_m`.
    """
    board = _table(value, "board_config", path)
    cameras = _table(board, "cameras", path)
    pair = _table(board, "stereo_config", path)
    left, right = (str(pair.get(key, "")) for key in ("left_cam", "right_cam"))
    field_deg = _table(cameras, left, path).get("hfov")
    name = f"{left}.hfov in {path.name}"
    if field_deg is None:
        raise errors.refuse(name, "must be given", field_deg, _EXAMPLE)
    errors.in_interval(name, field_deg, 1.0, 179.0, "Give degrees.")
    baseline_m = distance_m(_links(cameras, path), left, right or "right_cam", path)
    return DeviceCalibration(
        path=path, cameras=(), field_deg=float(field_deg), baseline_m=baseline_m
    )


def distance_m(links: Sequence[Link], left: str, right: str, path: Path) -> float:
    """Return the baseline of two cameras [m], over chains of links.

    Raises:
        InputError: if no chain connects them, or two chains contradict. Also if the cameras are
            turned or do not lie side by side.
    """
    name = f"extrinsics in {path.name}"
    ways = [*links, *(link.reversed() for link in links)]
    places: dict[str, _Place] = {left: (0.0, 0.0, 0.0)}
    turned: set[str] = set()
    for _ in links:
        for way in ways:
            if way.near in places and way.far not in places:
                places[way.far] = way.from_place(places[way.near])
                turned |= {way.far} if way.turned or way.near in turned else set()
    for way in ways:
        reached = way.near in places
        if reached and math.dist(way.from_place(places[way.near]), places[way.far]) > _ROUNDING_CM:
            rule, got = f"must lead to one place of {way.far}", f"two, one from {way.near}"
            raise errors.refuse(name, rule, got, "Drop the wrong one.")
    if right not in places:
        rule, got = f"must place {right} from {left}", ", ".join(places)
        raise errors.refuse(name, rule, got, _EXAMPLE)
    if right in turned:
        rule, advice = (
            f"must not turn {right} against {left}",
            "Only parallel cameras are modelled.",
        )
        raise errors.refuse(name, rule, "a rotation", advice)
    x, y, z = (number * _CM for number in places[right])
    return baseline_of((x, y, z), f"extrinsics of {left} and {right} in {path.name}")


def numbers(table: Any, axes: str, name: str, advice: str) -> _Place:
    """Return three numbers of a table, by the names of their axes, or refuse them."""
    values = [table.get(axis) if isinstance(table, Mapping) else None for axis in axes]
    if not all(errors.is_number(value) for value in values):
        raise errors.refuse(name, f"must have numbers {', '.join(axes)}", table, advice)
    for axis, value in zip(axes, values, strict=True):
        errors.in_interval(f"{axis} of {name}", value, -_LARGEST, _LARGEST)
    first, second, third = (float(value) for value in values if errors.is_number(value))
    return first, second, third


def _links(cameras: Mapping[str, Any], path: Path) -> list[Link]:
    links = []
    for name in cameras:
        extrinsics = _table(cameras, name, path).get("extrinsics")
        if isinstance(extrinsics, Mapping):
            place = f"{name}.specTranslation in {path.name}"
            step = numbers(extrinsics.get("specTranslation"), "xyz", place, _EXAMPLE)
            angles = (0.0, 0.0, 0.0)
            if "rotation" in extrinsics:
                turn = f"{name}.rotation in {path.name}"
                angles = numbers(extrinsics["rotation"], "rpy", turn, _EXAMPLE)
            turned = max(map(abs, angles)) > _TURNED_DEG
            links.append(Link(name, str(extrinsics.get("to_cam")), step, turned=turned))
    return links


def _table(value: Any, key: str, path: Path) -> Mapping[str, Any]:
    table = value.get(key) if isinstance(value, Mapping) else None
    if not isinstance(table, Mapping):
        raise errors.refuse(
            f"{key or 'left_cam'} in {path.name}", "must be a table", table, _EXAMPLE
        )
    return table
