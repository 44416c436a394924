"""The second camera implementation and the simulator on the light of one scene."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from starling.diagnosis.scenes import observation, scene_model
from starling.diagnosis.scenes.observation import StereoObservation
from starling.diagnosis.scenes.request import CAPTURED, Request, Source, simulation
from starling.diagnosis.validation.adapters import cameras, light_sets
from starling.diagnosis.validation.protocol import case, shoot
from starling.diagnosis.which import null
from starling.diagnosis.which import table as feature_table
from starling.diagnosis.which.candidates import Segment, candidates
from starling.diagnosis.which.fit import fit, room_folds
from starling.diagnosis.which.response import simulate_signature
from starling.patterns.errors import InputError
from starling.sim.captures import capture
from starling.sim.captures.capture import CaptureSet
from starling.sim.effects import setting
from starling.sim.scene.builtin import scenes
from starling.sim.scene.scene import Scene
from starling.sim.sensor import presets
from starling.sim.sensor.edits import with_values
from starling.sim.sensor.sensor import Sensor

SCENES = ("clutter:1", "clutter:2")


def nominal() -> Sensor:
    """Return an ideal camera of 160 x 90 with noise and lens blur."""
    camera, _ = setting.ideal(presets.load("d435"), scenes.clutter(1))
    size = [("width", 160), ("height", 90), ("fx_px", 81.0), ("fy_px", 81.0)]
    centre = [("cx_px", 79.5), ("cy_px", 44.5)]
    imager = [
        *(("imager.lens.blur_px", 0.6), ("imager.shot_noise", 1.0), ("imager.read_noise_e", 5.0)),
        *(("imager.black_level_dn", 4.0), ("imager.bit_depth", 8)),
    ]
    return with_values(camera, [*size, *centre, *imager, ("projector.power_w", 0.15)])


@pytest.fixture(scope="module")
def light(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("check") / "light"
    light_sets.write(folder, SCENES, nominal())
    return folder


def shot(light: Path, out: Path, **settings: float) -> CaptureSet:
    kind = "single" if settings else "null"
    single_case = case.Case(number=0, kind=kind, settings=settings, seed=5)
    shoot.shoot(light, single_case, out)
    return capture.open_set(out)


def test_light_holds_all_camera_values(light):
    camera = json.loads((light / cameras.NOMINAL).read_text())
    assert camera["read_noise_e"] == 5.0 and camera["ambient_w_m2"] > 0
    with np.load(light / "clutter-1" / light_sets.LIGHT) as arrays:
        laser, even = arrays["left_laser_e"], arrays["left_even_e"]
        assert laser.shape == (90, 160)
        lit = even > 0
        assert laser[lit].mean() == pytest.approx(
            even[lit].mean(), rel=0.15
        )  # Both have the same power.
        assert np.nanmax(np.abs(arrays["left_px"][lit])) <= np.tan(np.radians(45)) + 0.01


def test_both_cameras_agree_without_an_effect(light, tmp_path):
    """Levels within 2 % by thirds of the image; the lens blurs differ in shape, not in width."""
    captures = shot(light, tmp_path / "null")
    for scene in captures.scenes:
        model = scene_model.load_scene_model(scene, nominal())
        ours = model.observe(Request(source=Source.INFRARED))
        for side in ("left", "right"):
            theirs, simulated = getattr(model.real, side)[0], getattr(ours, side)[0]
            for part in np.array_split(np.arange(160), 3):
                level = float(theirs[:, part].mean()) - 4
                assert level == pytest.approx(float(simulated[:, part].mean()) - 4, rel=0.02)
        assert type(model.real) is StereoObservation


def test_effect_of_second_camera_is_measured(light, tmp_path):
    """Each implementation resamples a vertical offset of 0.5 px in its own way."""
    captures = shot(light, tmp_path / "offset", vertical_offset=0.5)
    scene_models = [scene_model.load_scene_model(scene, nominal()) for scene in captures.scenes]
    table = feature_table.build_feature_table(scene_models, Segment.IMAGE, cache=tmp_path / "cache")
    base = null.simulate_base(table, seeds=2)
    known = candidates(nominal(), scene_models[0].scene, Segment.IMAGE)
    (candidate,) = [each for each in known if each.name == "vertical_offset"]
    signature = simulate_signature(candidate, table, candidate.nodes)
    assert signature is not None
    result = fit(
        signature,
        base.likelihood(table.rows(CAPTURED), np.ones(len(table.names))),
        room_folds(["a", "b"]),
    )
    assert float(result.value) == pytest.approx(0.5, rel=0.25)
    assert result.gain.min() > null.LEAST_GAIN


def test_nothing_is_simulated_twice(light, tmp_path, monkeypatch):
    captures = shot(light, tmp_path / "null")
    model = scene_model.load_scene_model(captures.scenes[0], nominal())
    first = feature_table.build_feature_table([model], Segment.IMAGE, cache=tmp_path / "cache")
    change = first.change({"veil": 0.05})
    assert change is not None
    assert first.change({"veil": 0.05, "distortion": 0.1, "exposure": -1.0}) is None
    again = feature_table.build_feature_table([model], Segment.IMAGE, cache=tmp_path / "cache")
    monkeypatch.setattr(scene_model.SceneModel, "observe", None)
    cached = again.change({"veil": 0.05})
    assert cached is not None
    np.testing.assert_array_equal(cached, change)
    assert again.change({"veil": 0.05, "distortion": 0.1, "exposure": -1.0}) is None


def test_real_images_are_matched_again_with_other_settings(light, tmp_path):
    captures = shot(light, tmp_path / "null")
    model = scene_model.load_scene_model(captures.scenes[0], nominal())
    ours_px = observation.expect(model.real, StereoObservation).ours_px
    rematched, same = (
        model.observe(simulation(Source.REMATCHED, settings)) for settings in ({"median": 0}, {})
    )
    assert not np.array_equal(rematched.depth_px, ours_px, equal_nan=True)
    np.testing.assert_array_equal(same.depth_px, observation.quantise_depth(ours_px, nominal()))
    again = observation.read_observation(captures.scenes[0], nominal())
    assert isinstance(again, StereoObservation)


def test_scenes_in_different_light_are_refused(tmp_path, monkeypatch):
    def lit(name: str, sensor: Sensor) -> Scene:
        level = 0.1 if name == "clutter:1" else 0.2
        return with_ambient(scenes.clutter(1), level)

    monkeypatch.setattr(light_sets.sources, "load", lit)
    with pytest.raises(InputError, match="scenes must share one ambient light; got"):
        light_sets.write(tmp_path / "out", SCENES, nominal())
    assert not (tmp_path / "out").exists()


def with_ambient(scene: Scene, level: float) -> Scene:
    ambient = dataclasses.replace(scene.ambient, irradiance_w_m2=level)
    return dataclasses.replace(scene, ambient=ambient)


def test_missing_scenes_are_refused(tmp_path):
    with pytest.raises(InputError, match="scenes must be at least one, each once; got 0"):
        light_sets.write(tmp_path / "out", [], nominal())
    assert not (tmp_path / "out").exists()
