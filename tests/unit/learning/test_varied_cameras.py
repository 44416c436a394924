"""Cameras that differ from their assumed parameters: drawn departures and written captures."""

from __future__ import annotations

import dataclasses
import itertools
from collections import Counter
from types import SimpleNamespace

import numpy as np
import pytest

from starling.learning.data import simulated_captures, varied_cameras
from starling.patterns.errors import InputError
from starling.sim import effects
from starling.sim.captures import capture
from starling.sim.effects import setting
from starling.sim.reason import Reason
from starling.sim.scene.builtin import scenes
from starling.sim.sensor import presets
from starling.sim.sensor.edits import with_values
from starling.sim.stereo import depth

BELIEVED = with_values(
    presets.load("d435"),
    [
        *(("width", 64), ("height", 36), ("fx_px", 32.0), ("fy_px", 32.0)),
        *(("cx_px", 31.5), ("cy_px", 17.5)),
    ],
)
SCENE = scenes.clutter(1)
SEEDS = range(40)


def test_the_number_of_departures_and_the_seed():
    drawn = [varied_cameras.departures(BELIEVED, SCENE, seed) for seed in SEEDS]
    assert drawn[3] == varied_cameras.departures(BELIEVED, SCENE, 3) != drawn[4]
    late = ("matcher", "post")
    for settings in drawn:
        stages = [effects.named(name).stage.value in late for name in settings]
        assert Counter(stages) == Counter(varied_cameras.ROWS)
        setting.apply(BELIEVED, SCENE, settings)
    names = {name for settings in drawn for name in settings}
    assert len(names) > 50
    assert not {"motion", "model_shift", "baseline_error", "decimation"} & names


@pytest.mark.slow
def test_departures_are_at_most_half_of_the_range():
    """On the scale of the range: a strength from zero, a factor, and a length."""
    result: dict[str, list[float]] = {}
    for seed in range(300):
        for name, value in varied_cameras.departures(BELIEVED, SCENE, seed).items():
            result.setdefault(name, []).append(value)  # type: ignore[arg-type]
    for name, base, low, high in (
        ("crosstalk", 0.0, 0.01, 0.3),
        ("nir_reflectance", 1.0, 0.1, 10.0),
        ("vertical_offset", 0.0, -1.5, 1.5),
    ):
        values = np.array(result[name])
        assert len(values) > 10
        if base == 0 and low > 0:
            assert low <= values.min() and values.max() <= np.sqrt(low * high)
        elif low > 0:
            assert np.sqrt(low) <= values.min() < 0.6 and 1.6 < values.max() <= np.sqrt(high)
        else:
            assert -0.75 <= values.min() < -0.3 and 0.3 < values.max() <= 0.75


@pytest.fixture
def shot():
    shape = BELIEVED.height, BELIEVED.width
    nothing = np.full(shape, np.nan, np.float32)
    seen = np.full(shape, 2.0, np.float32)
    image = np.zeros(shape, np.uint8)
    return SimpleNamespace(
        ir_left=image,
        ir_right=image,
        layers=SimpleNamespace(truth=SimpleNamespace(depth_m=seen)),
        depth=depth.DepthMap(
            disparity_px=nothing,
            depth_m=nothing,
            valid=np.isfinite(nothing),
            reason=np.full(shape, Reason.UNKNOWN, np.uint32),
        ),
    )


def test_a_set_has_one_scene_for_each_camera(tmp_path, shot, monkeypatch):
    seen = []

    def simulated(stage, camera, *, seed, samples):
        seen.append(camera)
        return shot

    monkeypatch.setattr(varied_cameras.simulate, "simulate", simulated)
    monkeypatch.setattr(varied_cameras, "MitsubaScene", lambda scene: scene)
    monkeypatch.setattr(varied_cameras, "ATTEMPTS", 3)
    rates = varied_cameras.write(tmp_path / "set", ["clutter:1", "clutter:2"], BELIEVED, seed=5)
    assert rates == {"clutter-1": 1.0, "clutter-2": 1.0}
    assert len(seen) == 6  # All cameras are blind, so that all attempts are used.
    opened = capture.open_set(tmp_path / "set")
    assert [scene.room for scene in opened.scenes] == ["clutter-1", "clutter-2"]
    assert opened.info.source == "varied camera"
    assert all(item != second for item, second in itertools.combinations([*seen, BELIEVED], 2))
    assert all(dataclasses.replace(item, name=BELIEVED.name) == item for item in seen)


@pytest.mark.parametrize("names", [[], ["wall:1", "wall:1"]])
def test_scenes_must_be_unique(tmp_path, names):
    with pytest.raises(InputError, match="scenes must be at least one, each once; got"):
        simulated_captures.write(
            tmp_path / "set", names, BELIEVED, _never, verb="x", seed=0, arguments={}
        )


def _never(*_: object):
    raise AssertionError
