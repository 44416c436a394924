"""Calibrations that depthai stores on a device: units, rectified camera, and refusals."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest

import starling
from starling.patterns.errors import InputError
from starling.sim.sensor import presets
from tests.unit.sim.calibration_files import written
from tests.unit.sim.test_intrinsics import geometry

EEPROM: dict[str, Any] = {  # In the form of depthai-ros#742, with numbers of an OAK-D.
    "cameraData": [
        [
            0,
            {
                "cameraType": 0,
                "extrinsics": {
                    "specTranslation": {"x": 0.0, "y": 0.0, "z": 0.0},
                    "toCameraSocket": -1,
                    "translation": {"x": 0.0, "y": 0.0, "z": 0.0},
                },
                "height": 1080,
                "intrinsicMatrix": [[1500.0, 0.0, 950.0], [0.0, 1500.0, 540.0], [0.0, 0.0, 1.0]],
                "width": 1920,
            },
        ],
        [
            1,
            {
                "cameraType": 0,
                "extrinsics": {
                    "specTranslation": {"x": -7.5, "y": 0.0, "z": 0.0},
                    "toCameraSocket": 2,
                    "translation": {"x": -7.51, "y": 0.04, "z": -0.03},
                },
                "height": 800,
                "intrinsicMatrix": [[801.0, 0.0, 627.0], [0.0, 801.5, 410.0], [0.0, 0.0, 1.0]],
                "width": 1280,
            },
        ],
        [
            2,
            {
                "cameraType": 0,
                "extrinsics": {
                    "specTranslation": {"x": 3.75, "y": 0.0, "z": 0.0},
                    "toCameraSocket": 0,
                    "translation": {"x": 3.76, "y": 0.0, "z": 0.0},
                },
                "height": 800,
                "intrinsicMatrix": [[803.0, 0.0, 635.5], [0.0, 803.5, 404.5], [0.0, 0.0, 1.0]],
                "width": 1280,
            },
        ],
    ],
    "stereoRectificationData": {
        "leftCameraSocket": 1,
        "rightCameraSocket": 2,
        "rectifiedRotationLeft": [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
    },
    "version": 7,
}


def test_the_calibration_of_depthai_is_the_right_cameras_in_each_mode(tmp_path: Path) -> None:
    """Pixels of 800P; 400P averages 2x2 of them, 720P cuts 40 rows off at either end."""
    path = written(tmp_path, "calib.json", EEPROM)
    baseline_m = math.hypot(7.51, 0.04, 0.03) / 100
    full = starling.load_sensor("oak-d", mode="1280x800", camera_matrix=path)
    assert geometry(full) == pytest.approx((1280, 800, 803.0, 803.5, 635.5, 404.5, baseline_m))
    half = starling.load_sensor("oak-d", camera_matrix=path)
    assert geometry(half) == pytest.approx((640, 400, 401.5, 401.75, 317.5, 202.0, baseline_m))
    cropped = starling.load_sensor("oak-d", mode="1280x720", camera_matrix=path)
    assert geometry(cropped) == pytest.approx((1280, 720, 803, 803.5, 635.5, 364.5, baseline_m))
    (tmp_path / "mine.toml").write_text('name = "a"\ncamera_matrix = "calib.json"\n')
    assert geometry(presets.load(str(tmp_path / "mine.toml"))) == pytest.approx(geometry(full))


def eeprom(edit: Any) -> dict[str, Any]:
    table = json.loads(json.dumps(EEPROM))
    edit(table)
    return table


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (
            lambda table: table.update(cameraData={}),
            r"^cameraData in a.json must list pairs of a socket and a camera; got {}",
        ),
        (
            lambda table: table["cameraData"].append([3]),
            r"^cameraData in a.json must list pairs",
        ),
        (
            lambda table: table.pop("stereoRectificationData"),
            r"^stereoRectificationData in a.json must name two sockets of .*; got None and None",
        ),
        (
            lambda table: table["stereoRectificationData"].update(leftCameraSocket=-1),
            r"must name two sockets of cameraData; got -1 and 2\.",
        ),
        (
            lambda table: table["cameraData"][1][1]["extrinsics"].update(toCameraSocket=-1),
            r"^extrinsics in a.json must place 2 from 1; got 1\.",
        ),
        (
            lambda table: table["cameraData"][1][1]["extrinsics"].update(translation=None),
            r"^translation of socket 1 in a.json must have numbers x, y, z; got None",
        ),
        (
            lambda table: table["cameraData"][2][1].pop("intrinsicMatrix"),
            r"^socket 2 in a.json must have width, height and intrinsicMatrix",
        ),
        (
            lambda table: table["cameraData"][2][1].update(width=0),
            r"^socket 2 in a.json: width must be in",
        ),
        (
            lambda table: table["cameraData"][2][1].update(
                intrinsicMatrix=[[803, 0, 0], [0, 803, 0], [635.5, 404.5, 1]]
            ),
            r"^intrinsicMatrix of socket 2 in a.json must be .* Is it transposed",
        ),
        # Millimetres.
        (
            lambda table: table["cameraData"][1][1]["extrinsics"]["translation"].update(x=-75.1),
            r"^baseline in .* near the sensor's 0.075; got 0.751",
        ),
    ],
)
def test_wrong_calibrations_of_depthai_are_refused(tmp_path: Path, edit: Any, message: str) -> None:
    path = written(tmp_path, "a.json", eeprom(edit))
    with pytest.raises(InputError, match=message) as refusal:
        starling.load_sensor("oak-d", camera_matrix=path)
    assert "\n" not in str(refusal.value)
