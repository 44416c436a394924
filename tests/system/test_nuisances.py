"""Nuisance parameters of a scene: light, pattern scale, and pose of the reference.

**Rationale.** Captures are simulated with a scaled pattern, and their scene files are removed, as
for a real room. The fit must recover the scale from dots alone, and none for another pattern.
Settings of effects are compared with numbers computed by hand.
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
from starling.diagnosis.validation.adapters import cameras
from starling.diagnosis.which import attribution
from starling.diagnosis.which.candidates import Segment
from starling.sim import simulate
from starling.sim.captures import capture, png
from starling.sim.captures.capture import CapturedScene
from starling.sim.commands.simulate_captures import simulate_captures
from starling.sim.scene.scene import ModelError
from starling.sim.sensor.edits import with_values
from starling.sim.sensor.sensor import Sensor
from starling.sim.stereo.depth import to_code

WARM = 1.0013
SENSOR = cameras.builtin_camera(424, 240)
FITTED = {AMBIENT: Nuisance(0.4, 0.1), SCALE: Nuisance(1.0, 0.999)}


def captured(folder: Path, scale: float = WARM, scene: str = "clutter:1") -> CapturedScene:
    simulate_captures(scene, with_values(SENSOR, [("projector.pattern_scale", scale)]), folder)
    (scene_folder,) = capture.open_set(folder).scenes
    (scene_folder.path / "scene.toml").unlink()
    return scene_folder


@pytest.fixture(scope="module")
def warm(tmp_path_factory: pytest.TempPathFactory) -> CapturedScene:
    return captured(tmp_path_factory.mktemp("warm") / "set")


def fitted_scale(scene: CapturedScene, sensor: Sensor) -> float | None:
    nuisances = fit_scene.fit_pattern_scale(scene, sensor)
    return nuisances[SCALE].value if nuisances else None


@pytest.mark.slow
def test_the_scale_of_the_captured_pattern_is_recovered(warm):
    assert fitted_scale(warm, SENSOR) == pytest.approx(WARM, abs=1.5e-4)
    scaled = with_values(SENSOR, [("projector.pattern_scale", 1.001)])
    assert fitted_scale(warm, scaled) == pytest.approx(WARM, abs=1.5e-4)


@pytest.mark.long
def test_a_first_frame_with_depth_alone_is_skipped(warm, tmp_path):
    whole = shutil.copytree(warm.path.parent, tmp_path / "set")
    frame = whole / warm.name / "0"
    shutil.copytree(frame, frame.with_name("1"))
    for image in frame.glob("ir_*.png"):
        image.unlink()
    (scene,) = capture.open_set(whole).scenes
    assert fitted_scale(scene, SENSOR) == fitted_scale(warm, SENSOR)
    (known, estimates), (all_known, all_estimates) = (
        estimated.load_scene(folder, SENSOR) for folder in (scene, warm)
    )
    assert len(estimates) == len(all_estimates)
    assert known.ambient == all_known.ambient


def test_without_dots_ambient_light_is_not_fitted(warm, tmp_path):
    off = with_values(SENSOR, [("projector.power_w", 0.0)])
    assert fit_scene.fit_pattern_scale(warm, off) == {}
    assert fit_scene.fit_light(warm, estimated.load_scene(warm, off)[0], off, {})[1] == {}
    whole = shutil.copytree(warm.path.parent, tmp_path / "set")
    for image in whole.rglob("ir_*.png"):
        image.unlink()
    (blind,) = capture.open_set(whole).scenes
    assert fit_scene.fit_pattern_scale(blind, SENSOR) == {}
    assert fit_scene.fit_light(blind, estimated.load_scene(blind, SENSOR)[0], SENSOR, {})[1] == {}


@pytest.mark.long
def test_another_pattern_or_no_dots_have_no_scale(warm, tmp_path):
    scene = estimated.plain_surface(warm)
    for path, value in (("projector.pattern_seed", 3), ("projector.power_w", 0.0)):
        sensor = with_values(SENSOR, [(path, value)])
        assert fit_scene.estimate_pattern_scale(warm, scene, sensor) is None
    alone = captured(tmp_path / "alone")
    (alone.path / "0" / "ir_right.png").unlink()
    (again,) = capture.open_set(tmp_path / "alone").scenes
    assert fit_scene.estimate_pattern_scale(again, scene, SENSOR) is None


@pytest.mark.long
def test_a_scene_model_has_the_fitted_parameters(warm):
    model = scene_model.load_scene_model(warm, SENSOR)
    assert model.nuisances.keys() == {AMBIENT, SCALE, *TURN, *SHIFT}
    assert model.sensor.projector.pattern_scale == model.nuisances[SCALE].value != 1
    assert model.nuisances[AMBIENT].value == model.scene.ambient.irradiance_w_m2
    again = scene_model.load_scene_model(warm, SENSOR, fitted=FITTED)
    assert again.sensor.projector.pattern_scale == 0.999
    assert again.nuisances[SCALE] == FITTED[SCALE]


@pytest.mark.long
def test_a_displaced_reference_is_corrected(warm, tmp_path):
    """By about half, as few cells oppose the prior; the scene model uses the corrected one."""
    whole = shutil.copytree(warm.path.parent, tmp_path / "set")
    true_m, info = warm.truth_m(), warm.info
    error = ModelError(turn_deg=(0.2, -0.1, 0.1), shift_m=(0, 0, 0.02))
    code = to_code(pose.move_depth(true_m, info, error), info.depth_unit_m)
    (whole / warm.name / "truth.png").write_bytes(png.encode(code))
    (scene,) = capture.open_set(whole).scenes
    fitted = fit_scene.fit_reference_pose(scene, SENSOR)
    assert fitted.keys() == {*TURN, *SHIFT}
    corrected = fit_scene.correct_reference(scene, fitted)
    before, after = (
        np.nanmedian(np.abs(info.disparity_px(each.truth_m()) - info.disparity_px(true_m)))
        for each in (scene, corrected)
    )
    assert after < before / 2
    model = scene_model.load_scene_model(scene, SENSOR)
    assert {name: model.nuisances[name].value for name in fitted} == {
        name: nuisance.value for name, nuisance in fitted.items()
    }
    reference_px, known = model.strata.disparity_px, np.isfinite(model.strata.disparity_px)
    assert_allclose(reference_px[known], info.disparity_px(corrected.truth_m())[known])
    tried = attribution.segment_candidates(Segment.IMAGE, [model])
    assert "model_turn" not in {candidate.name for candidate in tried}
    assert fit_scene.shift_settings({"model_turn": 0.3}, model.nuisances) == {"model_turn": 0.3}


def test_each_scene_has_independent_noise_in_its_pose_fit(warm, monkeypatch):
    """Common noise would give a common error, which would look like an effect of the camera."""
    seeds: list[int] = []
    infrared = simulate.infrared

    def with_seed(*arguments: Any, seed: int) -> simulate.InfraredPair:
        seeds.append(seed)
        return infrared(*arguments, seed=seed)

    monkeypatch.setattr(simulate, "infrared", with_seed)
    for name in ("hall", "attic"):
        assert fit_scene.fit_reference_pose(dataclasses.replace(warm, name=name), SENSOR)
    assert len(set(seeds)) == len(seeds) == 2


def test_no_reference_is_moved_without_a_pair(warm, tmp_path):
    whole = shutil.copytree(warm.path.parent, tmp_path / "set")
    (whole / warm.name / "0" / "ir_right.png").unlink()
    (scene,) = capture.open_set(whole).scenes
    assert fit_scene.fit_reference_pose(scene, SENSOR) == {}
    assert fit_scene.correct_reference(scene, {}) is scene


def test_settings_depart_from_the_fitted_base():
    assert fit_scene.shift_settings({"gamma": 1.2}, FITTED) == {"gamma": 1.2}
    assert fit_scene.shift_settings({SCALE: 1.002, "gamma": 1.2}, FITTED) == pytest.approx(
        {SCALE: 1.001, "gamma": 1.2}
    )
    common = fit_scene.common_settings(FITTED)
    assert fit_scene.shift_settings(common, FITTED) == {AMBIENT: 0.1, SCALE: 0.999}
    assert fit_scene.shift_settings({AMBIENT: 0.6}, FITTED) == pytest.approx({AMBIENT: 0.3})
    assert fit_scene.shift_settings({AMBIENT: 0.2}, FITTED) == {AMBIENT: 0.0}
    assert fit_scene.apply_to_sensor(SENSOR, {AMBIENT: FITTED[AMBIENT]}) is SENSOR


@pytest.mark.long
def test_fitted_parameters_are_tried_only_against_another_capture(warm):
    """They cannot explain a gap of the captures that they were fitted to."""
    tried = {}
    for against in (None, warm):
        model = scene_model.load_scene_model(warm, SENSOR, against=against, fitted=FITTED)
        families = ["ambient", "pattern_scale"]
        _, screening = attribution.screen_segment(Segment.IMAGE, [model], families=families)
        tried[against] = {signature.name: signature for signature in screening.signatures}
    assert tried[None].keys() == {"sunlight"}
    assert tried[warm].keys() == {AMBIENT, SCALE, "sunlight"}
    assert tried[warm][AMBIENT].candidate.base == 0.4
    assert tried[warm][SCALE].candidate.base == 1.0
