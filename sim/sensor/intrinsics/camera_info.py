"""`camera_info` of ROS in YAML, as its calibrator writes it or `ros2 topic echo` prints it.

Sources: sensor_msgs/CameraInfo (K, P, Tx = -fx B in metres); camera_calibration_parsers.
"""

from __future__ import annotations

import re
from pathlib import Path

from starling.patterns import errors
from starling.sim.geometry.pinhole import Pinhole
from starling.sim.sensor.intrinsics.calibration import DeviceCalibration

_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
_KEY = re.compile(r"^([A-Za-z_]\w*)\s*:", re.MULTILINE)
_NAMES = {  # Name in either format, in lower case, to that of the message.
    "image_width": "width",
    "image_height": "height",
    "camera_matrix": "k",
    "projection_matrix": "p",
    "distortion_coefficients": "d",
}
_RECTIFIED = "Rectify the pair, and give its camera_info with P."


def is_message(text: str) -> bool:
    """Whether a text has the keys of a `camera_info`."""
    return {"width", "height", "k"} <= _blocks(text).keys()


def parse(text: str, path: Path) -> DeviceCalibration:
    """Read the intrinsics of the rectified image, and the baseline of a right camera.

    Raises:
        InputError: if a number is missing, or a distorted image has no rectified camera.
    """
    blocks = _blocks(text)
    size = {name: _whole(blocks[name], name, path) for name in ("width", "height")}
    k = _numbers(blocks["k"], "K", (9,), path)
    p = _numbers(blocks.get("p", ""), "P", (0, 12), path)
    p = p if any(p) else [*k[0:3], 0.0, *k[3:6], 0.0, *k[6:9], 0.0]
    if any(_values(blocks.get("d", ""))) and not any(_values(blocks.get("p", ""))):
        raise errors.refuse(path.name, "must have a rectified camera P", "none", _RECTIFIED)
    with errors.naming(path.name):
        camera = Pinhole(**size, fx_px=p[0], fy_px=p[5], cx_px=p[2], cy_px=p[6])
    baseline_m = -p[3] / p[0] if p[3] else None
    return DeviceCalibration(path=path, cameras=(camera,), baseline_m=baseline_m)


def _blocks(text: str) -> dict[str, str]:
    """Split the first message into the text of each key at the start of a line."""
    message = re.split(r"^---\s*$", text.lstrip("-\n "), maxsplit=1, flags=re.MULTILINE)[0]
    keys = list(_KEY.finditer(message))
    ends = [*(key.start() for key in keys[1:]), len(message)]
    return {
        _NAMES.get(key[1].lower(), key[1].lower()): message[key.end() : end]
        for key, end in zip(keys, ends, strict=False)
    }


def _values(block: str) -> list[float]:
    """Return the numbers of a list; `data:` starts it in a matrix with rows and columns."""
    listed = block.rpartition("data:")[2]
    return [float(word) for word in _NUMBER.findall(listed)]


def _numbers(block: str, name: str, counts: tuple[int, ...], path: Path) -> list[float]:
    values = _values(block)
    if len(values) not in counts:
        rule = f"must have {counts[-1]} numbers"
        raise errors.refuse(f"{name} in {path.name}", rule, len(values), "Is the text complete?")
    return values


def _whole(block: str, name: str, path: Path) -> int:
    try:
        return int(block)
    except ValueError:
        got = repr(block.strip()[:80])
        advice = "Give pixels."
        raise errors.refuse(f"{name} in {path.name}", "must be whole", got, advice) from None
