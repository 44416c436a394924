"""Text of `rs-enumerate-devices -c`: intrinsics by stream and size, extrinsics in metres."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from starling.patterns import errors
from starling.sim.geometry.pinhole import Pinhole
from starling.sim.sensor.intrinsics.calibration import DeviceCalibration, baseline_of

_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_HEAD = re.compile(r'Intrinsic of "([^"]+)"\s*/\s*(\d+)x(\d+)')
_PART = re.compile(r'(?:Intrinsic of|Extrinsic from) "([^"]+)"(?:\s+To\s+"([^"]+)")?')
_FIELD = re.compile(rf"^\W*(Width|Height|PPX|PPY|Fx|Fy)\s*:\s*({_NUMBER})\s*$", re.MULTILINE)
_COEFFICIENTS = re.compile(r"^\W*Coeffs\s*:(.*)$", re.MULTILINE)
_DEVICE = re.compile(r"^\W*Device info\s*:", re.MULTILINE)
_TRANSLATION = re.compile(r"Translation Vector:[ \t]*(.*)$", re.MULTILINE)
_ROTATION = re.compile(r"Rotation Matrix:(.*?)(?=Translation|\Z)", re.DOTALL)
# Depth has the camera of the left imager. Older programs do not number the imagers.
_STREAMS = ("Depth", "Infrared 1", "Infrared")
_RIGHT = "Infrared 2"
_DIGITS = 9  # Most digits of a width or height.
_TURNED = 0.01  # Largest departure of a rectified pair's rotation from the identity.
_ONE_DEVICE = "Keep the text of one device."
_COMPLETE = "Is the text complete?"


def is_listing(text: str) -> bool:
    """Whether a text lists intrinsics as librealsense does."""
    return _HEAD.search(text) is not None


def parse(text: str, path: Path) -> DeviceCalibration:
    """Read the depth stream's intrinsics of all sizes, and the imagers' distance.

    Raises:
        InputError: if a block lacks a number, has distortion, or no stream of depth is listed. Also
            for the text of several devices, or a pair that is not rectified.
    """
    devices = len(_DEVICE.findall(text))
    if devices > 1:
        raise errors.refuse(path.name, "must list one device", devices, _ONE_DEVICE)
    heads = list(_HEAD.finditer(text))
    for stream in _STREAMS:
        cameras: dict[tuple[int, int], Pinhole] = {}
        for head, block in _blocks(text, heads):
            if head[1] == stream:
                camera = _camera(head, block, path)
                size = (camera.width, camera.height)
                if cameras.setdefault(size, camera) != camera:
                    rule = "must have one camera of each size"
                    got = f"{stream} {head[2]}x{head[3]} twice"
                    raise errors.refuse(path.name, rule, got, _ONE_DEVICE)
        if cameras:
            baseline_m = _baseline_m(text, path)
            return DeviceCalibration(
                path=path, cameras=tuple(cameras.values()), baseline_m=baseline_m
            )
    listed = ", ".join(dict.fromkeys(head[1] for head in heads))
    advice = "Run rs-enumerate-devices -c with a depth camera."
    raise errors.refuse(path.name, "must list the intrinsics of Depth", listed, advice)


def _blocks(text: str, heads: list[re.Match[str]]) -> Iterator[tuple[re.Match[str], str]]:
    """Yield heads, each with its text up to the next head of any kind."""
    for head in heads:
        following = _PART.search(text, head.end())
        yield head, text[head.end() : following.start() if following else len(text)]


def _camera(head: re.Match[str], block: str, path: Path) -> Pinhole:
    if max(len(head[2]), len(head[3])) > _DIGITS:
        rule, got = f"must have at most {_DIGITS} digits", f"{head[2]}x{head[3]}"
        raise errors.refuse(f"image size in {path.name}", rule, got, _COMPLETE)
    name = f"{head[1]} {head[2]}x{head[3]} in {path.name}"
    fields: dict[str, float] = {"Width": int(head[2]), "Height": int(head[3])}
    for field, text in _FIELD.findall(block):
        if fields.setdefault(field, float(text)) != float(text):
            got = f"{fields[field]:g} and {text}"
            raise errors.refuse(name, f"must have one {field}", got, _COMPLETE)
    for field in ("PPX", "PPY", "Fx", "Fy"):
        if field not in fields:
            raise errors.refuse(name, f"must have {field}", "nothing", _COMPLETE)
    coefficients = _COEFFICIENTS.search(block)
    words = coefficients[1].split() if coefficients else []
    if any(not re.fullmatch(_NUMBER, word) or float(word) for word in words):
        rule, got = "must have coefficients of 0", " ".join(words)
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


def _baseline_m(text: str, path: Path) -> float | None:
    """Return the distance of the imagers; None if it is not listed."""
    name = f"extrinsics to {_RIGHT} in {path.name}"
    baselines = set()
    for head in _PART.finditer(text):
        if head[1] not in _STREAMS or head[2] != _RIGHT:
            continue
        following = _PART.search(text, head.end())
        block = text[head.end() : following.start() if following else len(text)]
        translation = _TRANSLATION.search(block)
        words = translation[1].split() if translation else []
        if len(words) != 3 or not all(re.fullmatch(_NUMBER, word) for word in words):
            rule, got = "must have a translation of three numbers", " ".join(words) or "nothing"
            raise errors.refuse(name, rule, got, _COMPLETE)
        x, y, z = (float(word) for word in words)
        rotation = _ROTATION.search(block)
        _refuse_turned(rotation[1].split() if rotation else [], name)
        baselines.add(baseline_of((x, y, z), name))
    if len(baselines) > 1:
        got = f"{sorted(baselines)} m"
        raise errors.refuse(name, "must have one baseline", got, _ONE_DEVICE)
    return baselines.pop() if baselines else None


def _refuse_turned(words: list[str], name: str) -> None:
    """Refuse a rotation matrix, row by row, that is not the identity."""
    whole = len(words) == 9 and all(re.fullmatch(_NUMBER, word) for word in words)
    matrix = np.array([float(word) for word in words]).reshape(3, 3) if whole else None
    if words and (matrix is None or np.abs(matrix - np.eye(3)).max() > _TURNED):
        rule, advice = "must have no rotation", "Only rectified pairs are modelled."
        raise errors.refuse(name, rule, " ".join(words), advice)
