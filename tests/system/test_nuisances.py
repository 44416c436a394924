"""What is fitted to each scene before effects are asked for: its light, its pattern's scale.

**Rationale.** Captures are simulated with a pattern that warmth has spread, and their scenes'
descriptions taken away, as of a real room. A fit by dots alone has to find the scale again; that
of another pattern has to find none. Effects depart from what was fitted, by hand-made numbers.
"""

from __future__ import annotations

import dataclasses
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from starling.diagnosis.scenes import estimated, fit_scene, pose, scene_model
from starling.diagnosis.scenes.fit_scene import AMBIENT, SCALE, SHIFT, TURN, Nuisance
from starling.diagnosis.validation.adapters import check_camera
from starling.diagnosis.which import attribution
from starling.diagnosis.which.candidates import Arm
from starling.sim import simulate
from starling.sim.captures import capture, png
from starling.sim.captures.capture import CapturedScene
from starling.sim.commands.simulate_captures import simulate_captures
from starling.sim.scene.scene import ModelError
from starling.sim.sensor.edits import with_values
from starling.sim.sensor.sensor import Sensor
from starling.sim.stereo.depth import to_code

WARM = 1.0013
SENSOR = check_camera.camera(424, 240)
FITTED = {AMBIENT: Nuisance(0.4, 0.1), SCALE: Nuisance(1.0, 0.999)}


def captured(folder: Path, scale: float = WARM, scene: str = "clutter:1") -> CapturedScene:
    simulate_captures(scene, with_values(SENSOR, [("projector.pattern_scale", scale)]), folder)
    (one,) = capture.open_set(folder).scenes
    (one.path / "scene.toml").unlink()
    return one


@pytest.fixture(scope="module")
def warm(tmp_path_factory: pytest.TempPathFactory) -> CapturedScene:
    return captured(tmp_path_factory.mktemp("warm") / "set")


def fitted(scene: CapturedScene, sensor: Sensor) -> float | None:
    found = fit_scene.of_dots(scene, sensor)
    return found[SCALE].own if found else None


def test_the_scale_is_found_that_captures_were_made_with(warm):
    assert fitted(warm, SENSOR) == pytest.approx(WARM, abs=1.5e-4)
    other = with_values(SENSOR, [("projector.pattern_scale", 1.001)])
    assert fitted(warm, other) == pytest.approx(WARM, abs=1.5e-4)


@pytest.mark.long
def test_where_the_first_frame_has_depth_alone_another_tells(warm, tmp_path):
    whole = shutil.copytree(warm.path.parent, tmp_path / "set")
    frame = whole / warm.name / "0"
    shutil.copytree(frame, frame.with_name("1"))
    for image in frame.glob("ir_*.png"):
        image.unlink()
    (scene,) = capture.open_set(whole).scenes
    assert fitted(scene, SENSOR) == fitted(warm, SENSOR)
    (known, estimates), (all_known, all_estimates) = (
        estimated.scene(one, SENSOR) for one in (scene, warm)
    )
    assert len(estimates) == len(all_estimates)
    assert known.ambient == all_known.ambient


def test_without_dots_ambient_light_is_not_fitted(warm, tmp_path):
    off = with_values(SENSOR, [("projector.power_w", 0.0)])
    assert fit_scene.of_dots(warm, off) == {}
    assert fit_scene.of_light(warm, estimated.scene(warm, off)[0], off) == {}
    whole = shutil.copytree(warm.path.parent, tmp_path / "set")
    for image in whole.rglob("ir_*.png"):
        image.unlink()
    (blind,) = capture.open_set(whole).scenes
    assert fit_scene.of_dots(blind, SENSOR) == {}
    assert fit_scene.of_light(blind, estimated.scene(blind, SENSOR)[0], SENSOR) == {}


@pytest.mark.long
def test_dots_of_another_pattern_or_none_tell_no_scale(warm, tmp_path):
    scene = estimated.surface(warm)
    for path, value in (("projector.pattern_seed", 3), ("projector.power_w", 0.0)):
        sensor = with_values(SENSOR, [(path, value)])
        assert fit_scene.pattern_scale(warm, scene, sensor) is None
    alone = captured(tmp_path / "alone")
    (alone.path / "0" / "ir_right.png").unlink()
    (again,) = capture.open_set(tmp_path / "alone").scenes
    assert fit_scene.pattern_scale(again, scene, SENSOR) is None


def test_a_subject_is_simulated_as_its_scene_was(warm):
    one = scene_model.subject(warm, SENSOR)
    assert one.nuisances.keys() == {AMBIENT, SCALE, *TURN, *SHIFT}
    assert one.sensor.projector.pattern_scale == one.nuisances[SCALE].own != 1
    assert one.nuisances[AMBIENT].own == one.scene.ambient.irradiance_w_m2
    again = scene_model.subject(warm, SENSOR, fitted=FITTED)
    assert again.sensor.projector.pattern_scale == 0.999
    assert again.nuisances[SCALE] == FITTED[SCALE]


def test_a_reference_that_stands_off_is_put_right(warm, tmp_path):
    """By disparity alone, and by half, as few squares tell of much more than is expected; what a
    subject is compared with, and made of, is that reference."""
    whole = shutil.copytree(warm.path.parent, tmp_path / "set")
    true_m, info = warm.truth_m(), warm.info
    off = pose.moved(true_m, info, ModelError(turn_deg=(0.2, -0.1, 0.1), shift_m=(0, 0, 0.02)))
    code = to_code(off, info.depth_unit_m)
    (whole / warm.name / "truth.png").write_bytes(png.encode(code))
    (scene,) = capture.open_set(whole).scenes
    found = fit_scene.of_reference(scene, SENSOR)
    assert found.keys() == {*TURN, *SHIFT}
    right = fit_scene.put_right(scene, found)
    before, after = (
        np.nanmedian(np.abs(info.disparity_px(one.truth_m()) - info.disparity_px(true_m)))
        for one in (scene, right)
    )
    assert after < before / 2
    one = scene_model.subject(scene, SENSOR)
    assert {name: one.nuisances[name].own for name in found} == {
        name: each.own for name, each in found.items()
    }
    known = np.isfinite(one.ground.disparity_px)
    assert_allclose(one.ground.disparity_px[known], info.disparity_px(right.truth_m())[known])
    assert "model_turn" not in {each.name for each in attribution.tried(Arm.IMAGE, [one])}
    assert fit_scene.own({"model_turn": 0.3}, one.nuisances) == {"model_turn": 0.3}


def test_each_scene_s_pose_is_fitted_with_noise_of_its_own(warm, monkeypatch):
    """Else what noise makes of one would be made of all, as the camera's own."""
    seeds: list[int] = []
    infrared = simulate.infrared

    def drawn(*arguments: Any, seed: int) -> simulate.Pair:
        seeds.append(seed)
        return infrared(*arguments, seed=seed)

    monkeypatch.setattr(simulate, "infrared", drawn)
    for name in ("hall", "attic"):
        assert fit_scene.of_reference(dataclasses.replace(warm, name=name), SENSOR)
    assert len(set(seeds)) == len(seeds) == 2


def test_no_reference_is_moved_without_a_pair(warm, tmp_path):
    whole = shutil.copytree(warm.path.parent, tmp_path / "set")
    (whole / warm.name / "0" / "ir_right.png").unlink()
    (scene,) = capture.open_set(whole).scenes
    assert fit_scene.of_reference(scene, SENSOR) == {}
    assert fit_scene.put_right(scene, {}) is scene


def test_effects_depart_from_what_a_scene_has_of_its_own():
    assert fit_scene.own({"gamma": 1.2}, FITTED) == {"gamma": 1.2}
    assert fit_scene.own({SCALE: 1.002, "gamma": 1.2}, FITTED) == pytest.approx(
        {SCALE: 1.001, "gamma": 1.2}
    )
    assert fit_scene.own(fit_scene.commonly(FITTED), FITTED) == {AMBIENT: 0.1, SCALE: 0.999}
    assert fit_scene.own({AMBIENT: 0.6}, FITTED) == pytest.approx({AMBIENT: 0.3})
    assert fit_scene.own({AMBIENT: 0.2}, FITTED) == {AMBIENT: 0.0}
    assert fit_scene.on_sensor(SENSOR, {AMBIENT: FITTED[AMBIENT]}) is SENSOR


@pytest.mark.long
def test_what_was_fitted_is_tried_against_another_capture_alone(warm):
    """Of the very images that it was fitted to it is no question."""
    tried = {}
    for against in (None, warm):
        one = scene_model.subject(warm, SENSOR, against=against, fitted=FITTED)
        families = ["ambient", "pattern_scale"]
        _, screen = attribution.screened(Arm.IMAGE, [one], families=families)
        tried[against] = {rough.name: rough for rough in screen.rough}
    assert tried[None].keys() == {"sunlight"}
    assert tried[warm].keys() == {AMBIENT, SCALE, "sunlight"}
    assert tried[warm][AMBIENT].candidate.base == 0.4
    assert tried[warm][SCALE].candidate.base == 1.0
