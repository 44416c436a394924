"""Learned residual of corrupted depth images."""

from __future__ import annotations

import dataclasses
import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

import starling
from starling.learning import residual
from starling.learning.commands.train_captures import train_captures
from starling.learning.data.example import Example, Image
from starling.learning.residual import LearnedHoles
from starling.patterns.errors import InputError
from starling.sim.captures import png
from starling.sim.commands.corrupt_captures import corrupt_captures
from starling.sim.corrupt import Corruptor
from starling.sim.reason import Reason
from starling.sim.sensor import edits, presets

MATRIX = np.array([[150.0, 0, 79.5], [0, 150.0, 59.5], [0, 0, 1]])
SENSOR = edits.with_camera(presets.load("d435"), MATRIX, (160, 120))
WALL = np.full((120, 160), 1.2, np.float32)


@dataclass
class Constant:
    """Predicts one probability."""

    value: float

    def probability(self, example: Example) -> Image:
        assert example.physics is not None and example.reflectance is not None
        np.testing.assert_allclose(example.reflectance, 0.3, rtol=1e-5)
        return np.full(example.depth_m.shape, self.value, np.float32)


def corrupted(value: float, seed: int = 0) -> np.ndarray:
    camera = Corruptor(SENSOR, MATRIX, residual=LearnedHoles(Constant(value)))
    reading = camera(WALL, reflectance=0.3, seed=seed)
    missing = np.isnan(reading.depth_m)
    np.testing.assert_array_equal(missing, reading.reason != Reason.VALID)
    np.testing.assert_array_equal(missing, reading.depth_u16 == 0)
    return reading.reason


def test_a_residual_adds_pixels_without_depth_and_no_depth() -> None:
    plain = Corruptor(SENSOR, MATRIX)(WALL, reflectance=0.3).reason
    np.testing.assert_array_equal(corrupted(0.0), plain)
    assert (corrupted(1.0) != Reason.VALID).all()
    half = corrupted(0.5)
    added = half == Reason.UNKNOWN
    np.testing.assert_array_equal(half[~added], plain[~added])
    assert 0.2 < added[:, 60:].mean() < 0.8


def test_residuals_of_one_seed_are_equal() -> None:
    np.testing.assert_array_equal(corrupted(0.5), corrupted(0.5))
    assert (corrupted(0.5) != corrupted(0.5, seed=1)).mean() > 0.05


def test_the_shipped_residual_is_close_to_the_physics() -> None:
    pytest.importorskip("torch")
    matrix = np.array([[600.0, 0, 319.5], [0, 600.0, 179.5], [0, 0, 1]])
    sensor = edits.with_camera(presets.load("d435"), matrix, (640, 360))
    wall = np.full((360, 640), 1.2, np.float32)
    plain = Corruptor(sensor, matrix)(wall)
    learned = Corruptor(sensor, matrix, residual=residual.load("hybrid"))(wall)
    assert np.isnan(learned.depth_m[np.isnan(plain.depth_m)]).all()
    assert np.isfinite(learned.depth_m).mean() > 0.5


@pytest.mark.parametrize("model", ["nope", Path("nope")])
def test_unknown_models_are_refused(model: str | Path) -> None:
    with pytest.raises(InputError, match=r"model must be a folder that"):
        residual.load(model)


SMALL = np.array([[75.0, 0, 39.5], [0, 75.0, 29.5], [0, 0, 1]])
DEVICE = edits.with_camera(presets.load("d435"), SMALL, (80, 60))


def seen_by_a_device(folder: Path) -> tuple[Path, np.ndarray]:
    """Captures of a device that loses depth right of boxes, without infrared; last clean depth."""
    y, x = np.mgrid[:60, :80]
    clean = np.full((60, 80), 1.5, np.float32)
    for number, left in enumerate((16, 26, 36)):
        clean = np.full((60, 80), 1.5, np.float32)
        clean[(y > 10) & (y < 50) & (x >= left) & (x < left + 20)] = 0.9
        path, simulated = folder / f"room{number}.npy", folder / f"set{number}"
        np.save(path, clean)
        corrupt_captures(path, DEVICE, simulated, camera_matrix=(75.0, 75.0, 39.5, 29.5))
        shutil.copytree(simulated, folder / "set", dirs_exist_ok=True)
        frame = folder / "set" / path.stem / "0"
        depth = png.read(frame / "depth.png", "depth").copy()
        depth[11:50, left + 20 : left + 27] = 0
        (frame / "depth.png").write_bytes(png.encode(depth))
        for name in ("ir_left.png", "ir_right.png", "frame.exr"):
            (frame / name).unlink()
    return folder / "set", clean


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "reference"), [("trees", "truth"), ("trees", "estimated"), ("network", "truth")]
)
@pytest.mark.filterwarnings("ignore:3 of 3 scenes have no truth.png")
def test_captures_without_infrared_train_a_residual(
    tmp_path: Path, method: str, reference: str
) -> None:
    """Pixels right of boxes lose depth, as those of the device do; two steps teach no network."""
    pytest.importorskip("torch")
    captures, clean = seen_by_a_device(tmp_path)
    if reference == "estimated":
        for path in captures.glob("*/truth.png"):
            path.unlink()
    train_captures(method, str(captures), tmp_path / "model", steps=2)
    reading = starling.corrupt(clean, SMALL, DEVICE, residual=tmp_path / "model")
    plain = starling.corrupt(clean, SMALL, DEVICE)
    missing, missed = np.isnan(reading.depth_m), np.isnan(plain.depth_m)
    assert missing[missed].all()
    assert (reading.reason[missing & ~missed] == Reason.UNKNOWN).all()
    if method == "trees":
        share = missing[15:45, 57:62].mean()
        assert share > missed[15:45, 57:62].mean() + 0.25
        assert share > 3 * missing[15:45, 66:].mean()


def test_models_without_physics_remove_depth() -> None:
    pytest.importorskip("torch")
    matrix = np.array([[600.0, 0, 319.5], [0, 600.0, 179.5], [0, 0, 1]])
    sensor = edits.with_camera(presets.load("d435"), matrix, (640, 360))
    wall = np.full((360, 640), 1.2, np.float32)
    reading = Corruptor(sensor, matrix, residual=residual.load("network-varied"))(wall)
    plain = Corruptor(sensor, matrix)(wall)
    assert np.isnan(reading.depth_m[np.isnan(plain.depth_m)]).all()
    assert np.isfinite(reading.depth_m).mean() > 0.5


def test_decimated_depth_is_refused() -> None:
    post = dataclasses.replace(SENSOR.post, decimation=2)
    sensor = dataclasses.replace(SENSOR, post=post)
    camera = Corruptor(sensor, MATRIX, residual=LearnedHoles(Constant(0.5)))
    with pytest.raises(InputError, match=r"post.decimation must be 1 with a residual; got 2"):
        camera(WALL, reflectance=0.3)
