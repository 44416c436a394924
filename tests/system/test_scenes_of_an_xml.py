"""Diagnosis of scenes whose `scene.toml` names a Mitsuba XML: effects, ambient light, exposure."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from starling.diagnosis.scenes import observation
from starling.diagnosis.scenes.fit_scene import AMBIENT, AUTO_EXPOSURE, EXPOSURE, GAIN
from starling.diagnosis.scenes.request import Source, simulation
from starling.diagnosis.scenes.scene_model import SceneModel, load_scene_model
from starling.diagnosis.validation.adapters import cameras
from starling.diagnosis.which import attribution
from starling.diagnosis.which.candidates import Segment, effects_on_bodies
from starling.diagnosis.which.table import build_feature_table
from starling.sim.captures import capture
from starling.sim.captures.capture import CapturedScene
from starling.sim.commands.simulate_captures import simulate_captures
from starling.sim.sensor.edits import with_values

SENSOR = cameras.builtin_camera(212, 120)
LIGHT_W_M2 = 0.6
XML = """<scene version="3.0.0">
  <sensor type="perspective"><transform name="to_world">
    <lookat origin="0, 0, 1.2" target="0, 0, 0" up="0, 1, 0"/></transform></sensor>
  <shape type="rectangle"><transform name="to_world"><scale value="3"/></transform>
    <bsdf type="diffuse"><rgb name="reflectance" value="0.6"/></bsdf></shape>
  <shape type="sphere"><float name="radius" value="0.2"/>
    <bsdf type="diffuse"><rgb name="reflectance" value="0.3"/></bsdf></shape>
</scene>"""
STILL = {"blooming"}  # No pixel is full.


@pytest.fixture(scope="module")
def xml(tmp_path_factory: pytest.TempPathFactory) -> CapturedScene:
    folder = tmp_path_factory.mktemp("xml")
    (folder / "ball.xml").write_text(XML)
    simulate_captures(
        str(folder / "ball.xml"),
        SENSOR,
        folder / "set",
        frames=2,
        effects={"ambient": LIGHT_W_M2},
    )
    (scene,) = capture.open_set(folder / "set").scenes
    return scene


@pytest.fixture
def changeable(xml: CapturedScene, tmp_path: Path) -> Path:
    shutil.copy(xml.path.parent.parent / "ball.xml", tmp_path)
    return shutil.copytree(xml.path.parent, tmp_path / "set") / xml.name


def model(folder: Path, *edits: tuple[str, Any]) -> SceneModel:
    (scene,) = capture.open_set(folder).scenes
    return load_scene_model(scene, with_values(SENSOR, list(edits)))


def level(scene: SceneModel) -> float:
    pairs = observation.expect(
        scene.observe(simulation(Source.INFRARED, {})), observation.StereoObservation
    )
    return float(pairs.left.mean()) - scene.sensor.left.black_level_dn


def test_unstated_ambient_light_is_fitted(xml: CapturedScene):
    fitted = load_scene_model(xml, SENSOR)
    assert fitted.nuisances[AMBIENT].value == pytest.approx(LIGHT_W_M2, rel=0.15)
    assert fitted.scene.ambient.irradiance_w_m2 == fitted.nuisances[AMBIENT].value
    tried = attribution.segment_candidates(Segment.IMAGE, [fitted])
    assert AMBIENT not in {candidate.name for candidate in tried}
    again = load_scene_model(xml, SENSOR, fitted=fitted.nuisances)
    assert again.nuisances == fitted.nuisances


def test_stated_ambient_light_is_used(changeable: Path):
    file = changeable / "scene.toml"
    file.write_text(f"ambient_w_m2 = 0.25\n{file.read_text()}")
    stated = model(changeable)
    assert stated.scene.ambient.irradiance_w_m2 == 0.25
    assert AMBIENT not in stated.nuisances


def test_the_recorded_exposure_replaces_that_of_the_base(changeable: Path):
    file = changeable / "0" / "frame.json"
    written = json.loads(file.read_text())
    as_given = model(changeable)
    assert not {EXPOSURE, GAIN, AUTO_EXPOSURE} & as_given.nuisances.keys()
    longer = {"exposure_s": 0.5 * written["exposure_s"], "gain": 1.5 * written["gain"]}
    file.write_text(json.dumps({**written, **longer}))
    replaced = model(changeable)
    for part in (replaced.sensor.left, replaced.sensor.right):
        assert (part.exposure_s, part.gain) == (longer["exposure_s"], longer["gain"])
    assert level(replaced) == pytest.approx(0.75 * level(as_given), rel=0.1)
    assert replaced.scene_settings({EXPOSURE: SENSOR.left.exposure_s}) == {
        EXPOSURE: longer["exposure_s"]
    }
    tried = attribution.segment_candidates(Segment.IMAGE, [replaced])
    assert not {EXPOSURE, GAIN} & {candidate.name for candidate in tried}
    file.write_text(json.dumps({"laser_power": 1.0}))
    assert model(changeable).sensor == as_given.sensor


def test_auto_exposure_gives_way_to_the_record_where_light_is_known(changeable: Path):
    metered = ("imager.auto_exposure_level", 0.3)
    known = model(changeable, metered)
    assert known.sensor.left.auto_exposure_level == 0
    assert known.nuisances[AUTO_EXPOSURE].common == 0.3
    (changeable / "scene.toml").unlink()
    estimated = model(changeable, metered)
    assert estimated.sensor.left.auto_exposure_level == 0.3
    assert AUTO_EXPOSURE not in estimated.nuisances


@pytest.mark.long
def test_every_effect_acts_on_shapes_of_an_xml_or_is_left_out(xml: CapturedScene):
    scene = load_scene_model(xml, SENSOR)
    table = build_feature_table([scene], Segment.IMAGE)
    tried = attribution.segment_candidates(Segment.IMAGE, [scene])
    assert not {candidate.effect.name for candidate in tried} & {*effects_on_bodies()}
    still = set()
    for candidate in tried:
        if candidate.name != candidate.effect.name:
            continue  # Further parameters act together with the first.
        node = max(candidate.nodes, key=lambda node: abs(float(node) - float(candidate.base)))
        change = table.change({candidate.name: node})
        if change is None or not np.abs(change).max() > 0:
            still.add(candidate.name)
    assert still == STILL
