"""Daylight and further depth images of a batch against the compiled path."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from starling.sim.corrupt import Corruptor
from starling.sim.sensor.sensor import Sensor
from tests.unit.sim.batch import steps

wp: Any = pytest.importorskip("warp", reason="warp-lang is not installed")

from tests.unit.sim.batch import both_paths  # noqa: E402

CORRELATION = 0.999  # Least correlation of the light of both paths.
RIGHT = steps.depth_image(0.05)
PROJECTOR = steps.depth_image(0.029)
UP = (0.2, -1.0, 0.4)


def still() -> Sensor:
    """A sensor without speckle, which the paths draw differently."""
    noisy = steps.sensor()
    return dataclasses.replace(noisy, projector=noisy.projector.steady())


@pytest.mark.parametrize(
    "inputs",
    [
        {"ambient_lux": 200.0},
        {"ambient_lux": 200.0, "up": UP},
        {"up": UP},
        {"right_depth_m": RIGHT},
        {"projector_depth_m": PROJECTOR},
        {"right_depth_m": RIGHT, "projector_depth_m": PROJECTOR, "up": UP, "ambient_lux": 80.0},
    ],
    ids=lambda inputs: "-".join(inputs),
)
@pytest.mark.parametrize("name", ["d435", "d415"])  # The D415 has two emitters.
def test_light_is_that_of_the_compiled_path(name: str, inputs: dict[str, Any]) -> None:
    corruptor, rig = both_paths.build(steps.sensor(name=name), {"ambient": 5.0})
    depth = steps.depth_image()
    reflectance = np.linspace(0.2, 0.8, depth.size, dtype=np.float32).reshape(depth.shape)
    compiled = corruptor.light(depth, reflectance=reflectance, **inputs)
    layers, sky = compiled.layers, compiled.scene.ambient.irradiance_w_m2
    views = both_paths.views(rig, depth, reflectance=reflectance, **inputs)
    assert layers.right is not None
    for view, layer in zip(views, (layers.left, layers.right), strict=True):
        light = view.light.numpy()[0]
        for ours, theirs in (
            (light[..., 0], layer.projector_direct * rig.light.power),
            (light[..., 1], layer.ambient * sky),
        ):
            assert np.corrcoef(ours.ravel(), theirs.ravel())[0, 1] >= CORRELATION
            assert ours.mean() == pytest.approx(theirs.mean(), rel=1e-3)
    lit = views[0].lit.numpy()[0] > 0
    assert (lit == layers.truth.lit).mean() >= both_paths.EQUAL_SHARE


@pytest.mark.parametrize(
    "inputs",
    [
        {"ambient_lux": 200.0},
        {"up": UP},
        {"right_depth_m": RIGHT},
        {"projector_depth_m": PROJECTOR},
        {"right_depth_m": RIGHT, "projector_depth_m": PROJECTOR},
    ],
    ids=lambda inputs: "-".join(inputs),
)
def test_reasons_and_depth_are_those_of_the_compiled_path(inputs: dict[str, Any]) -> None:
    reasons, depths, _ = both_paths.equal_shares(still(), **inputs)
    assert reasons >= both_paths.EQUAL_SHARE and depths >= both_paths.EQUAL_SHARE


def test_bright_light_from_above_moves_disparities_by_the_device_s_step_at_most() -> None:
    """Rounding in the matcher decides 0.7 % of them."""
    reasons, _, disparities = both_paths.equal_shares(still(), ambient_lux=200.0, up=UP)
    assert reasons >= both_paths.EQUAL_SHARE and disparities >= both_paths.EQUAL_SHARE


def test_environments_have_daylight_of_their_own(monkeypatch: pytest.MonkeyPatch) -> None:
    """Also in slices; the length of a zenith is without effect."""
    from starling.sim.batch import reading

    sensor = steps.without_noise(steps.sensor("imager.auto_exposure_level=0.0"))
    camera = Corruptor(sensor, steps.MATRIX)
    wall = np.full((steps.HEIGHT, steps.WIDTH), 1.5, np.float32)
    tilted = (wall / (1 - 0.3 * (np.arange(steps.HEIGHT)[:, None] - 59.5) / 150)).astype(np.float32)
    lux, ups = (20.0, 120.0), ((0.0, -1.0, 0.0), (0.0, 0.5, -1.0))
    monkeypatch.setattr(reading, "SLICE_BYTES", 1)
    seen = camera.batch(
        wp.array(np.stack([tilted] * 2)),
        ambient_lux=wp.array(lux, dtype=float),
        up=wp.array(3 * np.array(ups), dtype=float),
    ).ir_left.numpy()
    for number in range(2):
        expected = camera(tilted, ambient_lux=lux[number], up=ups[number]).ir_left
        assert np.abs(seen[number].astype(float) - expected).max() <= 1
    assert seen[1].mean() > seen[0].mean() + 2
