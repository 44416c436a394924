"""Calibration that depthai stores on a device: `CalibrationHandler.eepromToJsonFile`.

`cameraData` lists pairs of a socket's number and its camera: `width`, `height` and
`intrinsicMatrix` [px] of the image before rectification, and `extrinsics` to another socket.
Lengths are centimetres: `translation` of an OAK-D has about -7.5 in x (depthai-ros#742). The
rectified pair has the intrinsics of the right camera (`calibration_reader.py` of depthai-python).
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from starling.patterns import errors
from starling.sim.geometry.pinhole import Pinhole
from starling.sim.sensor import edits
from starling.sim.sensor.intrinsics import depthai_board
from starling.sim.sensor.intrinsics.calibration import DeviceCalibration

CAMERAS = "cameraData"  # Key that only these files have.
_PAIR = "stereoRectificationData"
_EXAMPLE = "Write the file with eepromToJsonFile of a calibrated device."


def parse(value: Mapping[str, Any], path: Path) -> DeviceCalibration:
    """Read the rectified intrinsics and the calibrated baseline of the stereo pair.

    Raises:
        InputError: if a key is missing, or the pair's cameras are not connected.
    """
    cameras = _cameras(value[CAMERAS], path)
    pair = value.get(_PAIR)
    sockets = [
        pair.get(key) if isinstance(pair, Mapping) else None
        for key in ("leftCameraSocket", "rightCameraSocket")
    ]
    left, right = (str(socket) for socket in sockets)
    for socket in (left, right):
        if socket not in cameras:
            rule, got = "must name two sockets of cameraData", f"{left} and {right}"
            raise errors.refuse(f"{_PAIR} in {path.name}", rule, got, _EXAMPLE)
    baseline_m = depthai_board.distance_m(_links(cameras, path), left, right, path)
    imager = _pinhole(cameras[right], f"socket {right} in {path.name}")
    return DeviceCalibration(path=path, cameras=(), imager=imager, baseline_m=baseline_m)


def _cameras(entries: Any, path: Path) -> dict[str, Mapping[str, Any]]:
    """Return the cameras by socket."""
    pairs = entries if isinstance(entries, list) else []
    valid = [
        pair
        for pair in pairs
        if isinstance(pair, list) and len(pair) == 2 and isinstance(pair[1], Mapping)
    ]
    if not valid or len(valid) != len(pairs):
        rule = "must list pairs of a socket and a camera"
        raise errors.refuse(f"{CAMERAS} in {path.name}", rule, entries, _EXAMPLE)
    return {str(socket): camera for socket, camera in valid}


def _links(cameras: Mapping[str, Mapping[str, Any]], path: Path) -> list[depthai_board.Link]:
    links = []
    for socket, camera in cameras.items():
        extrinsics = camera.get("extrinsics")
        goal = extrinsics.get("toCameraSocket") if isinstance(extrinsics, Mapping) else None
        if isinstance(extrinsics, Mapping) and str(goal) in cameras:  # -1 is none.
            name = f"translation of socket {socket} in {path.name}"
            step = depthai_board.numbers(extrinsics.get("translation"), "xyz", name, _EXAMPLE)
            links.append(depthai_board.Link(socket, str(goal), step))
    return links


def _pinhole(camera: Mapping[str, Any], name: str) -> Pinhole:
    matrix = camera.get("intrinsicMatrix")
    rows = matrix if isinstance(matrix, list) else []
    numbers = [number for row in rows if isinstance(row, list) for number in row]
    size = (camera.get("width"), camera.get("height"))
    if len(numbers) != 9 or not all(map(errors.is_number, (*numbers, *size))):
        rule = "must have width, height and intrinsicMatrix (3, 3)"
        raise errors.refuse(name, rule, (*size, matrix), _EXAMPLE)
    k = edits.checked_matrix(np.reshape(numbers, (3, 3)), f"intrinsicMatrix of {name}")
    with errors.naming(name):
        return Pinhole.from_matrix(k, (camera["width"], camera["height"]))
