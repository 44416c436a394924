"""Files of a colour camera in a capture set: picture, registered depth, geometry."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import cv2
import numpy as np
import pytest

from starling.patterns import InputError
from starling.sim.captures import info as capture_info
from starling.sim.captures import png, writer
from starling.sim.console.output import OutputFolder
from starling.sim.geometry import frames
from starling.sim.sensor import presets
from starling.sim.sensor.sensor import Colour
from starling.sim.stereo.depth import DepthMap

CAMERA = Colour(width=64, height=48, fx_px=60, fy_px=61, cx_px=32, cy_px=24)


def _depth() -> DepthMap:
    plane = np.ones((4, 6), np.float32)
    return DepthMap(
        disparity_px=plane,
        depth_m=plane,
        valid=plane > 0,
        reason=np.zeros((4, 6), np.uint32),
    )


def test_colour_and_registered_depth_have_separate_files(tmp_path: Path) -> None:
    colour = np.random.default_rng(0).integers(0, 256, (5, 7, 3)).astype(np.uint8)
    registered = np.full((5, 7), np.nan, np.float32)
    registered[2, 3] = 1.25
    image = np.zeros((4, 6), np.uint8)
    with OutputFolder(tmp_path / "out") as folder:
        writer.write_frame(
            folder, "a", 0, depth=_depth(), depth_unit_m=1e-3, infrared=(image, None),
            registered_m=registered, colour=colour,
        )  # fmt: skip
    frame = tmp_path / "out" / "a" / "0"
    assert {path.name for path in frame.iterdir()} == {
        *("ir_left.png", "depth.png", "depth_colour.png", "rgb.png", "frame.json"),
    }
    result = cv2.imread(str(frame / "rgb.png"), cv2.IMREAD_UNCHANGED)
    assert result is not None and np.array_equal(result[..., ::-1], colour)
    codes = png.read(frame / "depth_colour.png", "depth_colour")
    assert codes[2, 3] == 1250 and np.count_nonzero(codes) == 1


def test_info_holds_the_colour_camera_s_pose() -> None:
    posed = dataclasses.replace(CAMERA, position_m=(-0.015, 0.01, 0.002), rotation_deg=(0, 2, 0))
    sensor = dataclasses.replace(presets.load("d435"), colour=posed)
    info = writer.info_of(sensor, source="s", licence="l", notes="")
    assert info.colour is not None and info.colour.fy_px == 61
    left_from_colour = frames.pose(posed.position_m, posed.rotation_deg)
    back = np.array(info.colour_from_left) @ left_from_colour
    np.testing.assert_allclose(back, np.eye(4), atol=1e-12)
    assert "[colour]" in capture_info.dumps(info)


def test_info_without_colour_camera_has_no_pose() -> None:
    sensor = dataclasses.replace(presets.load("d435"), colour=None)
    info = writer.info_of(sensor, source="s", licence="l", notes="")
    assert info.colour is None and "colour" not in capture_info.dumps(info)


@pytest.mark.parametrize(
    "image",
    [np.zeros((4, 6), np.uint8), np.zeros((4, 6, 3), np.uint16), np.zeros((0, 6, 3), np.uint8)],
)
def test_only_colour_of_8_bits_is_written(image: np.ndarray) -> None:
    with pytest.raises(InputError, match=r"colour image must be \(h, w, 3\) of 8 bits; got \("):
        png.encode_colour(image)
