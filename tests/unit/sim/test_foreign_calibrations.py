"""Calibrations of other people: forms that are read, and those that would be read wrongly."""

from __future__ import annotations

import dataclasses
import json
import math
from pathlib import Path
from typing import Any

import pytest

from starling.patterns.errors import InputError
from starling.sim.sensor import intrinsics
from tests.unit.sim.calibration_files import (
    BASELINE,
    DEPTH,
    OAK,
    SMALL,
    block,
    moved,
    written,
)


def placed(x: float, y: float = 0.0, z: float = 0.0, **rotation: Any) -> dict[str, Any]:
    board = json.loads(json.dumps(OAK))
    extrinsics = board["board_config"]["cameras"]["CAM_B"]["extrinsics"]
    extrinsics["specTranslation"] = {"x": x, "y": y, "z": z}
    extrinsics["rotation"] = {"r": 0, "p": 0, "y": 0} | rotation
    return board


def looped() -> dict[str, Any]:
    board = json.loads(json.dumps(OAK))
    place = {"to_cam": "CAM_B", "specTranslation": {"x": 7.0, "y": 0, "z": 0}}
    board["board_config"]["cameras"]["CAM_A"]["extrinsics"] = place
    return board


def pair(translation: str, rotation: str = "1 0 0 0 1 0 0 0 1") -> str:
    head = 'Extrinsic from "Depth"\t  To\t  "Infrared 2" :\n Rotation Matrix:\n   '
    return f"{DEPTH}{head}{rotation}\n\n Translation Vector: {translation}\n\n"


def matrices(k: str = "[384, 0, 319.5, 0, 384, 239.5, 0, 0, 1]", more: str = "") -> str:
    text = "image_width: 640\nimage_height: 480\ncamera_matrix: {rows: 3, cols: 3, data: "
    return f"{text}{k}}}\n{more}"


def projection(numbers: str) -> str:
    return matrices(more=f"projection_matrix: {{rows: 3, cols: 4, data: [{numbers}]}}\n")


@pytest.mark.parametrize(
    "text",
    [
        matrices(),
        # Keys sorted as PyYAML dumps them.
        matrices(more="distortion_coefficients:\n  cols: 5\n  data: [0, 0, 0, 0, 0]\n  rows: 1\n"),
        "camera_matrix:\n  cols: 3\n  data:\n  - 384.0\n  - 0\n  - 319.5\n  - 0\n  - 3.84e2\n"
        "  - 239.5\n  - 0\n  - 0\n  - 1\n  rows: 3\nimage_height: 480\nimage_width: 640\n",
        matrices("[384, 0, 319.5, 0, 384, 239.5, 0, 0, 1]").replace("640", "640 # px"),
        matrices().replace("]}", "]}  # 3x3 of 2026"),
        matrices().replace("640", "'640'").replace("480", '"480"'),
        "%YAML:1.0\n---\n" + matrices().replace("{rows", "!!opencv-matrix {rows"),
        matrices(more="header:\n  stamp:\n    secs: 0\n  frame_id: 'it''s # left'\nbinning_x: 1\n"),
        matrices(more="roi: {x_offset: 0, y_offset: 0, height: 480, width: 640, do_rectify: no}\n"),
        '{"width": 640, "height": 480, "k": [384, 0, 319.5, 0, 384, 239.5, 0, 0, 1], "d": []}',
        projection("384, 0, 319.5, 0, 0, 384, 239.5, 0, 0, 0, 1, 0"),
    ],
)
def test_forms_of_camera_info_are_read(tmp_path: Path, text: str) -> None:
    names = ("a.yaml", "a.json") if text.startswith("{") else ("a.yaml",)
    for name in names:
        (camera,) = intrinsics.read(written(tmp_path, name, text)).cameras
        assert dataclasses.astuple(camera) == (640, 480, 384.0, 384.0, 319.5, 239.5)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            matrices("[384, 0, 0, 0, 384, 0, 319.5, 239.5, 1]"),
            r"^K in a.yaml .* Is it transposed\?",
        ),
        (matrices("[384, 50, 319.5, 0, 384, 239.5, 0, 0, 1]"), "^K in .* Rectify the image first"),
        (matrices("[384, 0, 319.5, 9, 384, 239.5, 0, 0, 1]"), "^K in .* Rectify the image first"),
        (matrices("[768, 0, 639, 0, 768, 479, 0, 0, 2]"), "^K in .* Divide by its last number"),
        (matrices("[384, 0, 319.5, 0, 1152, 239.5, 0, 0, 1]"), r"^fy / fx of 640x480 .*; got 3\.0"),
        (matrices("[384, 0, 640, 0, 384, 239.5, 0, 0, 1]"), r"^cx of .* in \[0, 639\]; got 640"),
        (matrices("[384, 0, 319.5, 0, 384, -1, 0, 0, 1]"), r"^cy of .* in \[0, 479\]; got -1"),
        (
            matrices("[.nan, 0, 319.5, 0, 384, 239.5, 0, 0, 1]"),
            "^K in a.yaml must be a list of num",
        ),
        (matrices("[9e999, 0, 319.5, 0, 384, 239.5, 0, 0, 1]"), "^K in a.yaml must be .*, finite"),
        (matrices("17"), "^K in a.yaml must be a list of numbers; got 17"),
        (projection("768, 0, 639, 0, 0, 768, 479, 0, 0, 0, 2, 0"), "^P in .* Divide by its last"),
        (projection("384, 40, 319.5, 0, 0, 384, 239.5, 0, 0, 0, 1, 0"), "^P in .* Rectify the im"),
        (
            projection("384, 0, 319.5, 0, 0, 384, 239.5, -19.2, 0, 0, 1, 0"),
            "^P in a.yaml must have a baseline along x only",
        ),
        (
            matrices(more="binning_x: 2\n"),
            "^binning_x in a.yaml must be 0 or 1; got 2. Give the ca",
        ),
        (matrices(more="binning_y: -1\n"), "^binning_y in a.yaml must be whole; got '-1'"),
        (
            matrices(more="roi:\n  width: 320\n  height: 240\n  x_offset: 9\n"),
            r"^roi in a.yaml must be the whole image; got \{'width': '320'",
        ),
        (matrices(more="roi: all\n"), "^roi in a.yaml must be a table; got all"),
        (matrices(more=matrices()), "must be plain YAML; .* the key 'image_width' is there twice"),
        (matrices(more="k: [1]\n"), "^a.yaml must have width, height and K once; got k twice"),
        (matrices(more="d: *anchor\n"), r"must be plain YAML; .* '\*anchor' cannot be read"),
        (matrices(more=" d: 1\n"), "must be plain YAML; .* 'd: 1' cannot be read"),
        (matrices(more="d: [1, 2\n"), "must be plain YAML; .* it ends inside brackets"),
        (matrices(more="d: [1] 2\n"), "must be plain YAML; .* ' 2' cannot be read"),
        (matrices(more="d: {1}\n"), "must be plain YAML; .* '}' cannot be read"),
        (matrices(more="d: [1: 2]\n"), r"must be plain YAML; .* ': 2\]' cannot be read"),
        (matrices(more=f"d: {'[' * 5000}{']' * 5000}\n"), "YAML; .* it is nested too deep"),
        ("# width: height: k:\n", "must be plain YAML; .* it is empty"),
        ("- width:\n- height:\n- k:\n", "^a.yaml must have width, height and K once; got no table"),
        ("width: 3\nheight: 2\nroi:\n  k: 4\n", "width, height and K once; got width, height, roi"),
    ],
)
def test_camera_info_that_would_be_read_wrongly_is_refused(
    tmp_path: Path, text: str, message: str
) -> None:
    with pytest.raises(InputError, match=message):
        intrinsics.read(written(tmp_path, "a.yaml", text))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("Device info:\n" + DEPTH + "Device info:\n" + SMALL, "^a.txt must list one device; got 2"),
        (
            DEPTH + DEPTH.replace("887", "900"),
            "^a.txt must have one camera of each size; got Depth 1280x720 twice",
        ),
        (
            pair("-0.05 0 0") + pair("-0.095 0 0"),
            r"^extrinsics .* one baseline; got \[0.05, 0.095\]",
        ),
        (
            DEPTH + BASELINE.format(x="-0.05").replace("Translation Vector: -", "Rest: "),
            "^extrinsics to Infrared 2 in a.txt must have a translation of .*; got nothing",
        ),
        (pair("nan 0 0"), "^extrinsics to .* must have a translation of .*; got nan 0 0"),
        (pair("0 0.05 0"), "^extrinsics to Infrared 2 in a.txt must lie along x; got 0, 0.05, 0 m"),
        (pair("0 0 0.05"), "^extrinsics to Infrared 2 in a.txt must lie along x"),
        (pair("-0.05 0 0", "0 1 0 1 0 0 0 0 1"), "^extrinsics .* must have no rotation; got 0 1 0"),
        (pair("-0.05 0 0", "1 0 0"), "^extrinsics .* must have no rotation; got 1 0 0"),
        (
            DEPTH.replace("Width:      \t1280", "Width: 848"),
            "must have one Width; got 1280 and 848",
        ),
        (DEPTH + "  Fx: 9\n", "^Depth 1280x720 in a.txt must have one Fx; got 887.829 and 9"),
        (block("Depth", "1280x720", 900, 640, 360, "nan"), "of 0; got 0 0 0 0 nan"),
        (
            DEPTH.replace("1280x720", "9" * 5000 + "x720"),
            "^image size in a.txt must have at most 9 d",
        ),
        (pair("-0.05 0 0").replace("631.", "99631."), r"^cx of 1280x720 in .* in \[0, 1279\]"),
    ],
)
def test_listings_of_other_cameras_are_refused(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(InputError, match=message) as refusal:
        intrinsics.read(written(tmp_path, "a.txt", text))
    assert len(str(refusal.value)) < 900


@pytest.mark.parametrize(
    ("board", "message"),
    [
        (
            placed(0, 7.5),
            "^extrinsics of CAM_B and CAM_C in a.json must lie along x; got 0, 0.075, 0",
        ),
        (placed(0, 0, 7.5), "^extrinsics of CAM_B and CAM_C in a.json must lie along x"),
        (placed(-7.5, p=90), "^extrinsics in a.json must not turn CAM_C against CAM_B"),
        (placed(-7.5, p="x"), "^CAM_B.rotation in a.json must have numbers r, p, y; got"),
        (looped(), "^extrinsics in a.json must lead to one place of CAM_"),
        (
            moved(10**400),
            r"^x of CAM_B.specTranslation in a.json must be in \[-10000, 10000\]; got 10",
        ),
        (moved(math.inf), "^x of CAM_B.specTranslation in a.json must be in"),
    ],
)
def test_boards_of_other_pairs_are_refused(
    tmp_path: Path, board: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputError, match=message) as refusal:
        intrinsics.read(written(tmp_path, "a.json", board))
    assert len(str(refusal.value)) < 900


def test_exchanged_cameras_give_a_warning(tmp_path: Path) -> None:
    """A board file of the vendor, AR0234DEV, has the other sign."""
    board = json.loads(json.dumps(OAK))
    board["board_config"]["stereo_config"] = {"left_cam": "CAM_C", "right_cam": "CAM_B"}
    with pytest.warns(UserWarning, match=r"CAM_C and CAM_B in a.json: the right camera lies left"):
        assert intrinsics.read(written(tmp_path, "a.json", board)).baseline_m == 0.075
    with pytest.warns(UserWarning, match=r"Infrared 2 in a.txt: .* by 0.05 m. Are they exchanged"):
        intrinsics.read(written(tmp_path, "a.txt", pair("0.05 0 0")))
    with pytest.raises(InputError, match=r"^CAM_B.hfov in a.json must be in") as refusal:
        board["board_config"]["cameras"]["CAM_B"]["hfov"] = 10**400
        board["board_config"]["stereo_config"] = {"left_cam": "CAM_B", "right_cam": "CAM_C"}
        intrinsics.read(written(tmp_path, "a.json", board))
    assert len(str(refusal.value)) < 900
