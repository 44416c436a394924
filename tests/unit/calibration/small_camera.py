"""Shared by calibration tests: a low-resolution preset, and its captures on disk."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from starling.sim.captures import info as capture_info
from starling.sim.captures import png, writer
from starling.sim.imaging.imager import Infrared
from starling.sim.sensor import presets
from starling.sim.sensor.edits import with_values
from starling.sim.sensor.sensor import Sensor
from starling.sim.stereo.depth import to_code


def small(name: str, width: int, height: int) -> Sensor:
    """A preset of fewer pixels over the same width of field, centred, its projector of 1 W."""
    preset = presets.load(name)
    scale = width / preset.width
    return with_values(
        preset,
        {
            "width": width,
            "height": height,
            "fx_px": preset.fx_px * scale,
            "fy_px": preset.fy_px * scale,
            "cx_px": (width - 1) / 2,
            "cy_px": (height - 1) / 2,
            "projector.power_w": 1.0,
        }.items(),
    )


def write_info(folder: Path, sensor: Sensor) -> None:
    """Write a set's `capture.toml`, the claimed sensor's."""
    info = writer.info_of(sensor, source="simulated", licence="Apache-2.0", notes="")
    folder.mkdir(exist_ok=True)
    (folder / capture_info.FILE).write_text(capture_info.dumps(info))


def write_scene(
    scene: Path,
    truth_m: NDArray[np.float32],
    pair: tuple[Infrared, Infrared | None],
    sensor: Sensor,
) -> None:
    """Write a scene of one frame, its infrared pair and its reference depth."""
    left, right = pair
    assert right is not None
    (scene / "0").mkdir(parents=True)
    images = {
        "truth.png": to_code(truth_m, sensor.post.depth_unit_m),
        "0/ir_left.png": left,
        "0/ir_right.png": right,
    }
    for name, image in images.items():
        (scene / name).write_bytes(png.encode(image))
