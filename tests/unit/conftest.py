"""Shared fixtures of the unit tests: a small synthetic capture set on disk."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

SHAPE = (48, 160)  # Wide enough for the columns right of 128, where figures are taken.

INFO = """sensor = "d415"
width = 160
height = 48
fx_px = 90.0
fy_px = 90.0
cx_px = 79.5
cy_px = 23.5
baseline_m = 0.05
depth_unit_m = 0.001
black_level_dn = 4
source = "made by a test"
licence = "Apache-2.0"
notes = ""
"""


def _write_set(path: Path, scenes: tuple[str, ...] = ("a", "b"), seed: int = 0) -> Path:
    rng = np.random.default_rng(seed)
    path.mkdir(parents=True)
    (path / "capture.toml").write_text(INFO)
    for scene in scenes:
        frame = path / scene / "0"
        frame.mkdir(parents=True)
        (path / scene / "room").write_text("kitchen\n")
        truth = np.full(SHAPE, 1000, np.uint16)
        depth = truth + rng.integers(0, 3, SHAPE).astype(np.uint16)
        depth[10:20, 140:150] = 0
        infrared = rng.integers(20, 90, SHAPE).astype(np.uint8)
        images = {"ir_left": infrared, "ir_right": np.roll(infrared, -4, 1), "depth": depth}
        for name, image in images.items():
            cv2.imwrite(str(frame / f"{name}.png"), image)
        cv2.imwrite(str(path / scene / "truth.png"), truth)
        (frame / "frame.json").write_text('{"gain": 1.0}')
    return path


@pytest.fixture(scope="session")
def write_set() -> Callable[..., Path]:
    """Return `write_set(path, scenes=("a", "b"), seed=0)`, which writes a small set."""
    return _write_set


@pytest.fixture
def small_set(tmp_path: Path) -> Path:
    """Return the folder of a small capture set, which the test may modify."""
    return _write_set(tmp_path / "set")
