"""Calibration of an OAK camera, as depthai's `eepromToJsonFile` writes it.

    cameraData: [[SOCKET, {width, height, intrinsicMatrix, distortionCoeff, extrinsics}], ...]
    stereoRectificationData: {leftCameraSocket, rightCameraSocket}

Translations are in centimetres. `extrinsics` maps points of a socket's camera to that of
`toCameraSocket`. Rectified images have the intrinsics of the right camera, as in depthai's own
homographies.

Source: luxonis/depthai-core, `EepromData`, `CameraInfo`, `Extrinsics`, `CalibrationHandler`;
depthai-python, example `calibration_reader`.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from starling.patterns import errors
from starling.sim import files
from starling.sim.captures.recordings.recording import ImagerCalibration
from starling.sim.geometry.frames import Pose

_CM = 0.01  # [m]
_COEFFICIENTS = (0, 4, 5, 8, 12, 14)  # Counts of distortion coefficients that OpenCV reads.


def find(folder: Path) -> Path | None:
    """Return the calibration in a folder, or None."""
    for path in sorted(folder.glob("*.json")):
        if b"cameraData" in files.read_bytes(path):
            return path
    return None


def is_calibration(path: Path) -> bool:
    """Whether a file is a calibration of this kind."""
    return path.suffix.lower() == ".json" and b"cameraData" in files.read_bytes(path)


def read(path: Path) -> tuple[tuple[ImagerCalibration, ImagerCalibration], Pose]:
    """Read both cameras of the stereo pair, and `right_from_left` [m].

    Raises:
        InputError: if a key is missing or the cameras are not connected.
    """
    table = files.parse_json(files.read_bytes(path), path)
    try:
        pair = table["stereoRectificationData"]
        cameras = {int(socket): camera for socket, camera in table["cameraData"]}
        left, right = int(pair["leftCameraSocket"]), int(pair["rightCameraSocket"])
        lenses = (_lens(cameras[left]), _lens(cameras[right]))
        poses = _poses(cameras, left)
        return lenses, poses[right]
    except (KeyError, TypeError, ValueError, IndexError) as error:
        rule = "must have cameraData, stereoRectificationData and extrinsics of the pair"
        got = f"{type(error).__name__} {error}"
        raise errors.refuse(path.name, rule, got, "Write it by eepromToJsonFile.") from error


def _lens(camera: Mapping[str, Any]) -> ImagerCalibration:
    coefficients = np.array(camera["distortionCoeff"], np.float64)
    if coefficients.size not in _COEFFICIENTS or int(camera.get("cameraType", 0)) != 0:
        raise ValueError("a distortion that is not OpenCV's")
    return ImagerCalibration(
        width=int(camera["width"]),
        height=int(camera["height"]),
        matrix=np.array(camera["intrinsicMatrix"], np.float64).reshape(3, 3),
        distortion=coefficients,
        model="rational_polynomial",
    )


def _poses(cameras: Mapping[int, Mapping[str, Any]], start: int) -> dict[int, Pose]:
    """Return `camera_from_start` of all sockets that are connected with the start."""
    links: list[tuple[int, int, Pose]] = []
    for socket, camera in cameras.items():
        goal = int(camera["extrinsics"]["toCameraSocket"])
        if goal >= 0:
            pose = _pose(camera["extrinsics"])
            links += [(socket, goal, pose), (goal, socket, np.linalg.inv(pose))]
    poses: dict[int, Pose] = {start: np.eye(4)}
    for _ in cameras:
        for near, far, pose in links:
            if near in poses and far not in poses:
                poses[far] = pose @ poses[near]
    return poses


def _pose(extrinsics: Mapping[str, Any]) -> NDArray[np.float64]:
    pose = np.eye(4)
    pose[:3, :3] = np.array(extrinsics["rotationMatrix"], np.float64).reshape(3, 3)
    pose[:3, 3] = [float(extrinsics["translation"][axis]) * _CM for axis in "xyz"]
    return pose
