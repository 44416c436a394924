"""`camera_info` of ROS in YAML, as its calibrator writes it or `ros2 topic echo` prints it.

Sources: sensor_msgs/CameraInfo (K, P, Tx = -fx B in metres, binning, roi);
camera_calibration_parsers.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from starling.patterns import errors
from starling.sim.geometry.pinhole import Pinhole
from starling.sim.sensor import edits
from starling.sim.sensor.intrinsics import plain_yaml
from starling.sim.sensor.intrinsics.calibration import DeviceCalibration

_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?", re.ASCII)
_WHOLE = re.compile(r"\d{1,9}", re.ASCII)
_NAMES = {  # Name in either format, in lower case, to that of the message.
    "image_width": "width",
    "image_height": "height",
    "camera_matrix": "k",
    "projection_matrix": "p",
    "distortion_coefficients": "d",
}
_KEY = re.compile(r"[\"']?\b(\w+)[\"']?[ \t]*:")
_RECTIFIED = "Rectify the pair, and give its camera_info with P."
_WHOLE_IMAGE = "Give the camera_info of the whole image."


def is_message(text: str) -> bool:
    """Whether a text has the keys of a `camera_info`."""
    return _has_names(_KEY.findall(text))


def is_table(value: object) -> bool:
    """Whether a table, read from JSON, has the keys of a `camera_info`."""
    return isinstance(value, Mapping) and _has_names(map(str, value))


def parse(text: str, path: Path) -> DeviceCalibration:
    """Read the intrinsics of the rectified image, and the baseline of a right camera.

    Raises:
        InputError: if the text is no YAML; also as `from_table`.
    """
    try:
        table = plain_yaml.parse(text)
    except ValueError as error:
        rule, advice = "must be plain YAML", f"In it, {error}."
        raise errors.refuse(path.name, rule, path, advice) from None
    return from_table(table, path)


def from_table(value: Any, path: Path) -> DeviceCalibration:
    """Read the intrinsics of the rectified image from a parsed message.

    Raises:
        InputError: if a number is missing, a matrix has no pinhole camera, or a distorted image has
            no rectified camera. Also for a part of an image.
    """
    table = _table(value, path)
    size = {name: _whole(table[name], name, path) for name in ("width", "height")}
    k = _matrix(_numbers(table["k"], "K", (9,), path).reshape(3, 3), "K", path)
    p = _numbers(table.get("p", []), "P", (0, 12), path)
    d = _values(table.get("d", []), "D", path)
    if np.any(d) and not p.any():
        raise errors.refuse(path.name, "must have a rectified camera P", "none", _RECTIFIED)
    _refuse_part(table, size, path)
    baseline_m = None
    if p.any():
        p = p.reshape(3, 4)
        k = _matrix(p[:, :3], "P", path)
        if p[1, 3] or p[2, 3]:
            rule, got = "must have a baseline along x only", p.tolist()
            advice = "Only horizontal pairs are modelled."
            raise errors.refuse(f"P in {path.name}", rule, got, advice)
        baseline_m = float(-p[0, 3] / p[0, 0]) if p[0, 3] else None
    with errors.naming(path.name):
        camera = Pinhole.from_matrix(k, (size["width"], size["height"]))
    return DeviceCalibration(path=path, cameras=(camera,), baseline_m=baseline_m)


def _has_names(names: Any) -> bool:
    known = {_NAMES.get(name.lower(), name.lower()) for name in names}
    return {"width", "height", "k"} <= known


def _table(value: Any, path: Path) -> dict[str, Any]:
    """Return a message with the names of sensor_msgs/CameraInfo."""
    rule, advice = "must have width, height and K once", "Give one camera_info."
    table: dict[str, Any] = {}
    for key, entry in value.items() if isinstance(value, Mapping) else ():
        name = _NAMES.get(str(key).lower(), str(key).lower())
        if name in table and name in ("width", "height", "k", "p", "d"):
            raise errors.refuse(path.name, rule, f"{name} twice", advice)
        table[name] = entry
    if not {"width", "height", "k"} <= table.keys():
        got = ", ".join(table) or "no table"
        raise errors.refuse(path.name, rule, got, advice)
    return table


def _refuse_part(table: Mapping[str, Any], size: Mapping[str, int], path: Path) -> None:
    """Refuse binning and a region of interest: the matrices are those of the whole image."""
    for name in ("binning_x", "binning_y"):
        if _whole(table.get(name, 0), name, path) > 1:
            got = table[name]
            raise errors.refuse(f"{name} in {path.name}", "must be 0 or 1", got, _WHOLE_IMAGE)
    roi = table.get("roi", {})
    if not isinstance(roi, Mapping):
        raise errors.refuse(f"roi in {path.name}", "must be a table", roi, _WHOLE_IMAGE)
    names = ("x_offset", "y_offset", "width", "height")
    region = [_whole(roi.get(name, 0), f"roi.{name}", path) for name in names]
    if region not in ([0, 0, 0, 0], [0, 0, size["width"], size["height"]]):
        rule = "must be the whole image"
        raise errors.refuse(f"roi in {path.name}", rule, dict(roi), _WHOLE_IMAGE)


def _values(value: Any, name: str, path: Path) -> list[float]:
    """Return the numbers of a list, or of a matrix with rows, columns and data."""
    listed = value.get("data", []) if isinstance(value, Mapping) else value
    if isinstance(listed, str) and not listed:
        listed = []
    numbers = [_number(each) for each in listed] if isinstance(listed, list) else [None]
    if None in numbers:
        rule, got = "must be a list of numbers", str(listed)[:80]
        raise errors.refuse(f"{name} in {path.name}", rule, got, "Is the text complete?")
    return [number for number in numbers if number is not None]


def _numbers(value: Any, name: str, counts: tuple[int, ...], path: Path) -> NDArray[np.float64]:
    values = _values(value, name, path)
    if len(values) not in counts:
        rule = f"must have {counts[-1]} numbers"
        raise errors.refuse(f"{name} in {path.name}", rule, len(values), "Is the text complete?")
    return np.array(values, np.float64)


def _number(value: Any) -> float | None:
    """Return a number, or the number of a word; None for other values."""
    if isinstance(value, str):
        return float(value) if _NUMBER.fullmatch(value) else None
    is_finite = errors.is_number(value) and abs(value) <= 1e300
    return float(value) if is_finite else None


def _whole(value: Any, name: str, path: Path) -> int:
    if _WHOLE.fullmatch(str(value)[:10]):
        return int(value)
    got = repr(str(value)[:80])
    raise errors.refuse(f"{name} in {path.name}", "must be whole", got, "Give pixels.")


def _matrix(matrix: NDArray[np.float64], name: str, path: Path) -> NDArray[np.float64]:
    return edits.checked_matrix(matrix, f"{name} in {path.name}")
