"""`starling match` on captures without reference depth, and with another f b."""

from __future__ import annotations

import warnings
from pathlib import Path

import cv2
import numpy as np
import pytest
import tomli_w

from starling.sim.commands.match_captures import match_captures
from starling.sim.sensor import edits, presets
from starling.sim.sensor.sensor import Sensor

HEIGHT, WIDTH, FOCAL_PX, BASELINE_M = 120, 320, 300.0, 0.05
SMALL = {
    **{"width": WIDTH, "height": HEIGHT, "fx_px": FOCAL_PX, "fy_px": FOCAL_PX},
    **{"cx_px": 159.5, "cy_px": 59.5},
}
HOLE = (slice(40, 60), slice(200, 260))


def sensor() -> Sensor:
    values = {**SMALL, "baseline_m": BASELINE_M, "matcher.search_px": 32, "post.near_m": 0.1}
    return edits.with_values(presets.load("d435"), values.items())


def captures(folder: Path, scale: float = 1.0) -> str:
    """Write a slanted, textured wall without truth.png, and a device's depth of another f b."""
    frame = folder / "wall" / "0"
    frame.mkdir(parents=True)
    table = {
        **SMALL,
        **{"sensor": "d435", "baseline_m": BASELINE_M, "depth_unit_m": 0.0001},
        **{"source": "made here", "licence": "-", "notes": ""},
    }
    (folder / "capture.toml").write_text(tomli_w.dumps(table))
    (folder / "wall" / "room").write_text("wall\n")
    texture = np.random.default_rng(0).integers(20, 220, (HEIGHT, WIDTH)).astype(np.float32)
    texture = cv2.GaussianBlur(texture, (0, 0), 0.8)
    rows, columns = np.mgrid[:HEIGHT, :WIDTH].astype(np.float32)
    disparity = 8 + 16 * rows / HEIGHT
    left = cv2.remap(texture, columns - disparity, rows, cv2.INTER_CUBIC, None, cv2.BORDER_WRAP)
    depth_m = scale * FOCAL_PX * BASELINE_M / disparity
    depth_m[HOLE] = 0
    images = {"ir_left": left.clip(0, 255).astype(np.uint8), "ir_right": texture.astype(np.uint8)}
    images["depth"] = (depth_m / 0.0001).round().astype(np.uint16)
    for name, image in images.items():
        cv2.imwrite(str(frame / f"{name}.png"), image)
    return str(folder)


def test_holes_are_compared_without_reference_depth(tmp_path: Path) -> None:
    """Only the device has a hole, outside the pixels that both maps know."""
    figures = match_captures(captures(tmp_path / "set"), sensor())["scenes"]["wall"]
    assert figures["ours"]["ndp_iou"] is None
    assert figures["agreement"]["ndp_iou"] < 0.5
    assert figures["agreement"]["fill"] > 0.9


def test_depths_of_another_focal_length_are_noticed(tmp_path: Path) -> None:
    line = r"wall: the device's depth is 1\.03\d+ times ours .* f b = 15\.4\d px m; .* 15\.00"
    with pytest.warns(UserWarning, match=line):
        match_captures(captures(tmp_path / "set", scale=1.03), sensor())


def test_depths_of_the_same_focal_length_are_not_reported(tmp_path: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        match_captures(captures(tmp_path / "set"), sensor())
