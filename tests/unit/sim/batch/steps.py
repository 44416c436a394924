"""A curved wall with two boxes, and the sensors that see it."""

from __future__ import annotations

import dataclasses

import numpy as np

from starling.sim.arrays import Image
from starling.sim.sensor import edits, presets
from starling.sim.sensor.sensor import Sensor

WIDTH, HEIGHT, FOCAL = 160, 120, 150.0
MATRIX = np.array([[FOCAL, 0, 79.5], [0, FOCAL, 59.5], [0, 0, 1]])


def depth_image(place: float = 0.0) -> Image:
    """Depth (h, w) [m] seen at a place [m] on the baseline; a corner has no surface."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    moved = x + round(FOCAL * place / 1.5)
    depth = (1.5 + 0.3 * np.sin(moved / WIDTH * 6) + 0.2 * y / HEIGHT).astype(np.float32)
    for z, rows, first, last in ((0.7, slice(30, 60), 53, 80), (0.9, slice(60, 84), 96, 128)):
        shift = round(FOCAL * place / z)
        depth[rows, first - shift : last - shift] = z
    depth[:5, :20] = np.nan
    return depth


def sensor(*changes: str, name: str = "d435") -> Sensor:
    """A stock sensor with the camera of `depth_image`, which searches 64 disparities."""
    seen = edits.with_camera(presets.load(name), MATRIX, (WIDTH, HEIGHT))
    return edits.apply(edits.apply(seen, ["matcher.search_px=64"]), changes)


def without_noise(noisy: Sensor) -> Sensor:
    """The sensor without speckle and noise that is drawn; fixed patterns stay."""
    quiet = {"shot_noise": 0.0, "read_noise_e": 0.0, "row_noise_e": 0.0}
    return dataclasses.replace(
        noisy,
        projector=noisy.projector.steady(),
        left=dataclasses.replace(noisy.left, **quiet),
        right=dataclasses.replace(noisy.right, **quiet),
    )
