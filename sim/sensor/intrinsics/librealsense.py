"""Text of `rs-enumerate-devices -c`: intrinsics by stream and size, extrinsics in metres."""

from __future__ import annotations

import math
import re
from pathlib import Path

from starling.patterns import errors
from starling.sim.geometry.pinhole import Pinhole
from starling.sim.sensor.intrinsics.calibration import DeviceCalibration

_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_HEAD = re.compile(r'Intrinsic of "([^"]+)"\s*/\s*(\d+)x(\d+)')
_FIELD = re.compile(rf"^\W*(Width|Height|PPX|PPY|Fx|Fy)\s*:\s*({_NUMBER})\s*$", re.MULTILINE)
_COEFFICIENTS = re.compile(r"^\W*Coeffs\s*:(.*)$", re.MULTILINE)
_EXTRINSIC = re.compile(
    r'Extrinsic from "([^"]+)"\s+To\s+"([^"]+)"\s*:.*?'
    rf"Translation Vector:\s*({_NUMBER})\s+({_NUMBER})\s+({_NUMBER})",
    re.DOTALL,
)
# Depth has the camera of the left imager. Older programs do not number the imagers.
_STREAMS = ("Depth", "Infrared 1", "Infrared")
_RIGHT = "Infrared 2"


def is_listing(text: str) -> bool:
    """Whether a text lists intrinsics as librealsense does."""
    return _HEAD.search(text) is not None


def parse(text: str, path: Path) -> DeviceCalibration:
    """Read the depth stream's intrinsics of all sizes, and the imagers' distance.

    Raises:
        InputError: if a block lacks a number, has distortion, or no stream of depth is listed.
    """
    streams: dict[str, dict[tuple[int, int], Pinhole]] = {}
    heads = list(_HEAD.finditer(text))
    for number, head in enumerate(heads):
        if head[1] not in _STREAMS:
            continue
        end = heads[number + 1].start() if number + 1 < len(heads) else len(text)
        camera = _camera(head, text[head.end() : end], path)
        streams.setdefault(head[1], {})[camera.width, camera.height] = camera
    for stream in _STREAMS:
        if stream in streams:
            cameras = tuple(streams[stream].values())
            return DeviceCalibration(path=path, cameras=cameras, baseline_m=_baseline_m(text))
    listed = ", ".join(dict.fromkeys(head[1] for head in heads))
    advice = "Run rs-enumerate-devices -c with a depth camera."
    raise errors.refuse(path.name, "must list the intrinsics of Depth", listed, advice)


def _camera(head: re.Match[str], block: str, path: Path) -> Pinhole:
    fields = {name: float(value) for name, value in _FIELD.findall(block)}
    name = f"{head[1]} {head[2]}x{head[3]} in {path.name}"
    for field in ("PPX", "PPY", "Fx", "Fy"):
        if field not in fields:
            raise errors.refuse(name, f"must have {field}", "nothing", "Is the text complete?")
    coefficients = _COEFFICIENTS.search(block)
    if coefficients and any(float(word) for word in re.findall(_NUMBER, coefficients[1])):
        rule, got = "must have coefficients of 0", coefficients[1].strip()
        raise errors.refuse(name, rule, got, "Only rectified pairs are modelled.")
    with errors.naming(name):
        return Pinhole(
            width=int(head[2]),
            height=int(head[3]),
            fx_px=fields["Fx"],
            fy_px=fields["Fy"],
            cx_px=fields["PPX"],
            cy_px=fields["PPY"],
        )


def _baseline_m(text: str) -> float | None:
    for match in _EXTRINSIC.finditer(text):
        if match[1] in _STREAMS and match[2] == _RIGHT:
            return math.hypot(*(float(match[axis]) for axis in (3, 4, 5)))
    return None
