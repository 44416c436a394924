"""Calibrations of devices: three formats, their units, and refusals."""

from __future__ import annotations

import dataclasses
import json
import math
from pathlib import Path
from typing import Any

import pytest

import starling
from starling.patterns.errors import InputError
from starling.sim.sensor import intrinsics, presets
from starling.sim.sensor.sensor import Sensor
from tests.unit.sim.calibration_files import (
    BASELINE,
    COLOUR,
    D415,
    DEPTH,
    ECHO,
    FILE,
    OAK,
    SMALL,
    block,
    moved,
    without,
    written,
)


def geometry(sensor: Sensor) -> tuple[float, ...]:
    names = ("width", "height", "fx_px", "fy_px", "cx_px", "cy_px", "baseline_m")
    return tuple(getattr(sensor, name) for name in names)


def test_librealsense_lists_every_mode(tmp_path: Path) -> None:
    """A listing is used at the size of the sensor; the rest stays that of the mode."""
    path = written(tmp_path, "rs.txt", D415)
    wide = starling.load_sensor("d415", camera_matrix=path)
    b = 0.0547803528606892
    f, cx, cy = 887.829284667969, 631.876708984375, 373.140869140625
    assert geometry(wide) == (1280, 720, f, f, cx, cy, b)
    assert wide.left == presets.load("d415").left
    f, cx, cy = 591.886169433594, 314.58447265625, 248.76057434082
    for size in ("640x480", "640x480@60"):
        narrow = starling.load_sensor("d415", mode=size, camera_matrix=str(path))
        assert geometry(narrow) == (640, 480, f, f, cx, cy, b)
    (tmp_path / "mine.toml").write_text('base = "d415"\ncamera_matrix = "rs.txt"\n')
    assert presets.load(str(tmp_path / "mine.toml")) == wide
    listed = presets.load(str(tmp_path / "mine.toml"), mode="640x480")
    assert geometry(listed) == (640, 480, f, f, cx, cy, b)
    assert presets.load(str(tmp_path / "mine.toml"), mode="848x480").fx_px == pytest.approx(f)


def test_keys_of_the_file_win_over_its_calibration(tmp_path: Path) -> None:
    written(tmp_path, "rs.txt", D415)
    text = 'base = "d415"\ncamera_matrix = "rs.txt"\nfx_px = 900.0\n'
    path = str(written(tmp_path, "mine.toml", text))
    assert presets.load(path).fx_px == 900.0
    assert presets.load(path, mode="640x480").fx_px == pytest.approx(600.0)


def test_infrared_serves_where_depth_is_not_listed(tmp_path: Path) -> None:
    text = block("Infrared 1", "1280x720", 900.0, 640.0, 360.0).replace("\t", " ")
    calibration = intrinsics.read(written(tmp_path, "rs.txt", "> " + text))
    assert calibration.camera(1280, 720).fx_px == 900.0
    assert calibration.baseline_m is None


def test_camera_info_of_the_right_camera_has_the_baseline(tmp_path: Path) -> None:
    """P holds -fx B in metres; the second message is not read."""
    mine = starling.load_sensor("d435", camera_matrix=written(tmp_path, "info.yaml", ECHO))
    assert geometry(mine) == (848, 480, 424.2, 424.3, 423.4, 236.0, pytest.approx(0.05))


def test_camera_info_of_a_raw_image_has_the_rectified_camera(tmp_path: Path) -> None:
    """Its size chooses the mode."""
    mine = starling.load_sensor("d435", camera_matrix=written(tmp_path, "info.yaml", FILE))
    wanted = presets.load("d435", mode="640x480")
    assert geometry(mine) == (640, 480, 384.2, 384.2, 319.5, 236.4, wanted.baseline_m)
    assert mine.left == wanted.left


def test_a_board_of_depthai_is_in_centimetres_and_degrees(tmp_path: Path) -> None:
    path = written(tmp_path, "oak.json", OAK)
    mine = starling.load_sensor("d415", camera_matrix=path)
    focal_px = 640 / math.tan(math.radians(71.86 / 2))
    assert geometry(mine) == (1280, 720, focal_px, focal_px, 639.5, 359.5, 0.075)
    narrow = starling.load_sensor("d435", mode="640x480", camera_matrix=path)
    assert narrow.fx_px == pytest.approx(768 / 2 / math.tan(math.radians(71.86 / 2)))
    chained = json.loads(json.dumps(OAK))
    cameras = chained["board_config"]["cameras"]
    cameras["CAM_B"]["extrinsics"] = {
        "to_cam": "CAM_A", "specTranslation": {"x": -3.75, "y": 0, "z": 0},
    }  # fmt: skip
    assert intrinsics.read(written(tmp_path, "c.json", chained)).baseline_m == pytest.approx(0.075)


def test_a_file_without_a_base_takes_size_and_camera(tmp_path: Path) -> None:
    written(tmp_path, "info.yaml", ECHO)
    mine = presets.load(
        str(written(tmp_path, "a.toml", 'name = "a"\ncamera_matrix = "info.yaml"\ncx_px = 420.0\n'))
    )
    assert geometry(mine) == (848, 480, 424.2, 424.3, 420.0, 236.0, pytest.approx(0.05))


def test_a_structured_light_camera_keeps_its_projector_on_the_baseline(tmp_path: Path) -> None:
    board = json.loads(json.dumps(OAK))
    board["board_config"]["cameras"]["CAM_B"]["extrinsics"]["specTranslation"]["x"] = -7.4
    mine = starling.load_sensor("kinect-v1", camera_matrix=written(tmp_path, "a.json", board))
    assert mine.projector.position_m == (mine.baseline_m, 0.0, 0.0)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.txt", "hello", r"^camera_matrix must be output of rs-enumerate-devices -c, a camera_"),
        ("a.txt", COLOUR, r"^a.txt must list the intrinsics of Depth; got Color"),
        (
            "a.txt",
            DEPTH.replace("PPX", "PX"),
            r"^Depth 1280x720 in a.txt must have PPX; got nothing",
        ),
        (
            "a.txt",
            block("Depth", "1280x720", 0.9, 640, 360),
            r"^Depth 1280x720 in a.txt: fx_px must",
        ),
        ("a.txt", block("Depth", "1280x720", 900, 640, 360, "0.1"), r"must have coefficients of 0"),
        (
            "a.txt",
            SMALL + DEPTH.replace("1280x720", "1280x800").replace("\t720", "\t800"),
            r"must have the image size 848x480",
        ),
        # Millimetres and centimetres: beyond any camera, and beyond this one.
        (
            "a.txt",
            DEPTH + BASELINE.format(x="-54.78"),
            r"^baseline in .*a.txt \[m\] must be in \[0.0",
        ),
        (
            "a.yaml",
            ECHO.replace("-21.21", "-2121"),
            r"^baseline in .*near the sensor's 0.05015; got 5",
        ),
        (
            "a.yaml",
            ECHO.replace("-21.21", "-21210"),
            r"^baseline in .* must be in \[0.0005, 10\]; got",
        ),
        (
            "a.json",
            moved(-75),
            r"^baseline in .*a.json.*near the sensor's 0.05015; got 0.75\. Is it",
        ),
        (
            "a.yaml",
            ECHO.replace("424.", "54."),
            r"^focal length in .* near the sensor's 430.1; got 54.2",
        ),
        ("a.yaml", ECHO.replace("k: [424.2, ", "k: ["), r"^K in a.yaml must have 9 numbers; got 8"),
        ("a.yaml", ECHO.replace("- -21.21\n", ""), r"^P in a.yaml must have 12 numbers; got 11"),
        (
            "a.yaml",
            FILE.split("projection")[0],
            r"^a.yaml must have a rectified camera P; got none",
        ),
        (
            "a.yaml",
            ECHO.replace("width: 848", "width: x"),
            r"^width in a.yaml must be whole; got 'x'",
        ),
        ("a.yaml", ECHO.replace("width: 848", "width: 0"), r"^a.yaml: width must be in"),
        ("a.json", {}, r"^board_config in a.json must be a table; got None"),
        ("a.json", without("board_config", "stereo_config"), r"^stereo_config in a.json must be"),
        (
            "a.json",
            without("board_config", "stereo_config", "left_cam"),
            r"^left_cam in a.json must be a table",
        ),
        (
            "a.json",
            without("board_config", "stereo_config", "right_cam"),
            r"^extrinsics in a.json must place right_cam from CAM_B; got CAM_B, CAM_C, CAM_A",
        ),
        (
            "a.json",
            without("board_config", "cameras", "CAM_B", "hfov"),
            r"^CAM_B.hfov in a.json must be given; got None",
        ),
        ("a.json", moved("x"), r"^CAM_B.specTranslation in a.json must have numbers x, y, z; got"),
        ("a.json", [], r"^board_config in a.json must be a table"),
        ("a.json", "{", r"^a.json must be JSON"),
    ],
)
def test_wrong_calibrations_are_refused(
    tmp_path: Path, name: str, content: Any, message: str
) -> None:
    with pytest.raises(InputError, match=message) as refusal:
        starling.load_sensor("d435", camera_matrix=written(tmp_path, name, content))
    assert "\n" not in str(refusal.value)


def test_a_field_of_view_is_in_degrees(tmp_path: Path) -> None:
    board = json.loads(json.dumps(OAK))
    board["board_config"]["cameras"]["CAM_B"]["hfov"] = 1.25e-2
    with pytest.raises(
        InputError, match=r"^CAM_B.hfov in a.json must be in \[1, 179\]; .* degrees"
    ):
        intrinsics.read(written(tmp_path, "a.json", board))


def test_sizes_that_do_not_fit_are_refused(tmp_path: Path) -> None:
    written(tmp_path, "info.yaml", FILE)
    written(tmp_path, "oak.json", OAK)
    for text, message in (
        (
            'base = "d435"\nmode = "848x480"\ncamera_matrix = "info.yaml"',
            "image size 848x480; got 64",
        ),
        ('base = "xtion"\ncamera_matrix = "nowhere.yaml"', "nowhere.yaml must be readable"),
        ('name = "a"\ncamera_matrix = "oak.json"', "width and height must be given with camera_m"),
        ('name = "a"\ncamera_matrix = "info.yaml"\nwidth = 64', "image size 64x480; got 640x480"),
        ('name = "a"\ncamera_matrix = "info.yaml"\nwidth = true', "width and height must be given"),
    ):
        with pytest.raises(InputError, match=message):
            presets.load(str(written(tmp_path, "a.toml", text)))


def test_the_matrix_as_an_array_still_works() -> None:
    matrix = [[600.0, 0, 319.5], [0, 600.0, 239.5], [0, 0, 1]]
    sensor = starling.load_sensor("d435", camera_matrix=matrix, size=(640, 480))  # pyright: ignore
    assert dataclasses.astuple(sensor)[1:4] == (640, 480, 600.0)
