"""Learned residual of corrupted depth images."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from starling.learning import residual
from starling.learning.data.example import Example, Image
from starling.learning.residual import LearnedHoles
from starling.patterns.errors import InputError
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


def test_models_without_physics_are_refused() -> None:
    pytest.importorskip("torch")
    with pytest.raises(InputError, match="residual must be of a method on physics"):
        residual.load("network-varied")


def test_decimated_depth_is_refused() -> None:
    post = dataclasses.replace(SENSOR.post, decimation=2)
    sensor = dataclasses.replace(SENSOR, post=post)
    camera = Corruptor(sensor, MATRIX, residual=LearnedHoles(Constant(0.5)))
    with pytest.raises(InputError, match=r"post.decimation must be 1 with a residual; got 2"):
        camera(WALL, reflectance=0.3)
