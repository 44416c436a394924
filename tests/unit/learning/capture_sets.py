"""A tiny capture set on disk: pillars before walls, one in each of four rooms."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np

from starling.learning.data.example import Image, Mask
from starling.sim.captures import info, png
from starling.sim.sensor import presets
from starling.sim.sensor.edits import with_values
from starling.sim.sensor.sensor import Sensor
from starling.sim.stereo.depth import to_code
from tests.unit.learning.step_scenes import INFO, SHAPE, step_scene

ROOMS = ("attic", "cellar", "hall", "study")
SCENES = tuple(f"{room}-view" for room in ROOMS)  # One scene per room.
INFO_OF_SET = dataclasses.replace(INFO, sensor="d435", black_level_dn=4.0)
LEFT_BAND = 5  # Columns that do not count: 100/1280 of 64.
UNKNOWN = slice(0, 4)  # Rows with unknown reference.


def write(folder: Path, *, rooms: tuple[str, ...] = ROOMS) -> Path:
    """Write the set. The first rows of each reference are unknown, like gaps in a scan."""
    folder.mkdir(parents=True)
    (folder / info.FILE).write_text(info.dumps(INFO_OF_SET))
    for number, room in enumerate(rooms):
        truth_m, ndp, infrared = drawn(number)
        scene = folder / f"{room}-view"
        (scene / "0").mkdir(parents=True)
        (scene / "room").write_text(f"{room}\n")
        known_m = truth_m.copy()
        known_m[UNKNOWN] = np.nan
        images = {
            "truth": to_code(known_m, INFO.depth_unit_m),
            "0/depth": to_code(np.where(ndp, np.float32(np.nan), truth_m), INFO.depth_unit_m),
            "0/ir_left": infrared,
            "0/ir_right": np.roll(infrared, -4, axis=1),
        }
        for name, image in images.items():
            (scene / f"{name}.png").write_bytes(png.encode(image))
    return folder


def drawn(number: int) -> tuple[Image, Mask, np.ndarray]:
    """Reference depth [m], holes and left image, all (h, w).

    Half-occluded pixels next to the pillar have no depth, and elsewhere one random pixel in fifty.
    """
    scene = step_scene(number)
    assert scene.ndp is not None
    rng = np.random.default_rng(number)
    ndp = scene.ndp | (rng.random(SHAPE) < 0.02)
    infrared = np.where(rng.random(SHAPE) < 0.2, 120, 30) + rng.integers(0, 20, SHAPE)
    return scene.depth_m, ndp, infrared.astype(np.uint8)


def sensor() -> Sensor:
    """Preset of the set's device, with the set's geometry and a uniform, bright pattern."""
    camera = INFO_OF_SET.geometry_into(presets.load("d435"))
    return with_values(camera, [("projector.power_w", 1.0)])
