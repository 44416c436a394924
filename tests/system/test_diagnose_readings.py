"""Captured observations, their simulation, and captures that separate effects."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from starling.diagnosis.scenes import stability
from starling.diagnosis.scenes.observation import (
    FullObservation,
    SceneObservation,
    StereoObservation,
    common_content,
    expect,
    match_pairs,
    read_observation,
)
from starling.diagnosis.scenes.request import Source, simulation
from starling.diagnosis.scenes.scene_model import SceneModel, load_scene_model
from starling.diagnosis.validation.adapters import light_sets
from starling.diagnosis.validation.protocol import case, shoot
from starling.diagnosis.which.candidates import Segment
from starling.diagnosis.which.discrimination import MENU, discriminate
from starling.sim import simulate
from starling.sim.captures import capture
from starling.sim.commands import simulate_captures
from starling.sim.render.mitsuba_scene import MitsubaScene
from starling.sim.sensor.edits import with_values
from tests.system.test_diagnose import SCENES, sensor

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two repeats of one scene by a camera without effects."""
    folder = tmp_path_factory.mktemp("readings")
    light_sets.write(folder / "light", SCENES[:1], sensor())
    null_case = case.Case(number=0, kind="null", settings={}, seed=7)
    shoot.shoot(folder / "light", null_case, folder / "null", frames=2)
    return folder


def infrared(model: SceneModel, settings: dict[str, Any], *, seed: int = 0) -> StereoObservation:
    request = simulation(Source.INFRARED, settings, seed=seed)
    return expect(model.observe(request), StereoObservation)


def load(folder: Path) -> SceneModel:
    return load_scene_model(capture.open_set(folder).scenes[0], sensor())


def test_the_number_of_complete_repeats_is_common(place, tmp_path):
    fewer = shutil.copytree(place / "null", tmp_path / "fewer")
    (fewer / "clutter-1" / "1" / "ir_right.png").unlink()
    two, one_pair = (capture.open_set(folder).scenes[0] for folder in (place / "null", fewer))
    first, second = common_content(
        *(read_observation(scene, sensor()) for scene in (two, one_pair))
    )
    assert first.repeats == second.repeats == 1
    assert read_observation(two, sensor()).repeats == 2
    assert load_scene_model(one_pair, sensor()).frames == 1


def test_images_of_more_bits_are_matched_at_that_depth(place):
    scene = capture.open_set(place / "null").scenes[0]
    read = read_observation(scene, sensor())
    deep = [image.astype(np.uint16) << 4 for image in (read.left, read.right)]
    disparity_px = match_pairs(deep[0][:1], deep[1][:1], sensor())
    both = np.isfinite(disparity_px) & np.isfinite(read.ours_px)
    assert both.mean() > 0.6 and np.median(np.abs(disparity_px - read.ours_px)[both]) < 0.1


def test_a_simulated_capture_and_its_simulation_have_independent_noise(place):
    """Otherwise captures by `starling simulate` would show no gap due to noise."""
    model = load(place / "null")
    seed = simulate_captures.scene_seed(0, model.name)
    layers = simulate.render_layers(MitsubaScene(model.scene), sensor(), samples=4)
    captured = simulate.infrared(layers, model.scene, sensor(), seed=seed).left
    still = with_values(sensor(), [("imager.shot_noise", 0.0), ("imager.read_noise_e", 0.0)])
    mean = simulate.infrared(layers, model.scene, still).left.astype(float)
    simulated = infrared(model, {}).left
    noise = [(image - mean).ravel() for image in (captured, simulated[0])]
    spread = [float(np.std(image)) for image in noise]
    assert min(spread) > 0.3 and spread[0] == pytest.approx(spread[1], rel=0.1)
    quantised = np.corrcoef([(image - mean).ravel() for image in simulated])[0, 1]
    assert abs(np.corrcoef(noise)[0, 1] - quantised) < 0.05


def test_pairs_without_the_projector_are_read_for_a_sensor_with_it_off(place, tmp_path):
    """Depth belongs to the lit pairs and is not read; without unlit pairs the lit ones are used."""
    both = shutil.copytree(place / "null", tmp_path / "both")
    frame = both / "clutter-1" / "0"
    for side in ("left", "right"):
        dark = cv2.imread(str(frame / f"ir_{side}.png"), cv2.IMREAD_UNCHANGED) // 2
        cv2.imwrite(str(frame / f"ir_{side}_off.png"), dark)
    code = np.full(sensor_shape(both), 1000, np.uint16)
    for number in ("0", "1"):
        cv2.imwrite(str(both / "clutter-1" / number / "depth.png"), code)
    scene = capture.open_set(both).scenes[0]
    off = with_values(sensor(), [("projector.power_w", 0.0)])
    on, unlit = read_observation(scene, sensor()), read_observation(scene, off)
    assert isinstance(on, FullObservation) and on.repeats == 2
    assert type(unlit) is StereoObservation and unlit.repeats == 1
    np.testing.assert_array_equal(unlit.left[0], on.left[0] // 2)
    plain = capture.open_set(place / "null").scenes[0]
    assert read_observation(plain, off).repeats == 2


def sensor_shape(captures: Path) -> tuple[int, int]:
    return capture.open_set(captures).info.shape


def test_time_steps_are_no_repeats(place, tmp_path):
    steps = shutil.copytree(place / "null", tmp_path / "steps")
    scene = capture.open_set(steps).scenes[0]
    assert read_observation(scene, sensor()).repeats == 2
    (scene.path / "0" / "frame.json").write_text(json.dumps({"counts": "steps of time"}))
    assert read_observation(scene, sensor()).repeats == 1


def test_motion_between_repeats_is_detected(place):
    """A shift by one pixel; not noise, nor a fifth more light."""
    read = read_observation(capture.open_set(place / "null").scenes[0], sensor())
    left = expect(read, StereoObservation).left
    first, second = left
    brighter = np.clip(second * 1.2, 0, 255).astype(np.uint8)
    assert not stability.images_moved(left) and not stability.images_moved(
        np.stack([first, brighter])
    )
    assert stability.images_moved(np.stack([first, np.roll(second, 1, axis=1)]))


def test_repeats_with_motion_are_flagged_and_read(place, tmp_path):
    shaken = shutil.copytree(place / "null", tmp_path / "shaken")
    path = shaken / "clutter-1" / "1" / "ir_left.png"
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert image is not None
    cv2.imwrite(str(path), np.roll(image, 1, axis=1))
    read = read_observation(capture.open_set(shaken).scenes[0], sensor())
    assert read.moved and read.repeats == 2
    still = read_observation(capture.open_set(place / "null").scenes[0], sensor())
    assert not still.moved and still.repeats == 2


def test_a_moved_body_is_detected_in_depth_alone(place, tmp_path):
    """Not noise, nor depth of noise only, nor repeats without common valid pixels."""
    alone = shutil.copytree(place / "null", tmp_path / "alone")
    folder = alone / "clutter-1"
    for path in folder.glob("*/ir_*.png"):
        path.unlink()
    rng = np.random.default_rng(0)
    info = capture.open_set(alone).info
    disparity_px = 30 + 0.1 * rng.standard_normal((2, *info.shape))

    def read(maps_px: NDArray[np.float64]) -> SceneObservation:
        depth_m = info.fx_px * info.baseline_m / maps_px
        code = np.where(maps_px > 0, depth_m / info.depth_unit_m, 0)
        for number, image in enumerate(np.rint(code).astype(np.uint16)):
            cv2.imwrite(str(folder / str(number) / "depth.png"), image)
        return read_observation(capture.open_set(alone).scenes[0], sensor())

    assert not read(disparity_px).moved
    displaced = disparity_px.copy()
    displaced[1, 40:80, 60:120] += 3
    assert read(displaced).moved
    assert not read(30 + 3 * rng.standard_normal(displaced.shape)).moved
    half = np.arange(info.width) < info.width // 2
    disjoint = np.stack([np.where(half, 30.0, -1.0), np.where(half, -1.0, 30.0)])
    assert not read(np.repeat(disjoint[:, None], info.height, axis=1)).moved


def test_learning_uses_the_holes_that_are_evaluated(place):
    finer = with_values(sensor(), [("imager.dropped_bits", 2)])
    model = load_scene_model(capture.open_set(place / "null").scenes[0], finer)
    settings = {"interreflection": 0.0, "veil": 0.02}
    holes = [~np.isfinite(infrared(model, settings, seed=seed).ours_px[0]) for seed in (0, 1)]
    np.testing.assert_array_equal(model.physics(settings, seeds=(0, 1)).ndp, np.mean(holes, 0))
    pair = expect(model.real, StereoObservation)
    model.real = pair.with_depth(pair.ours_px)
    both = [model.observe(model.request(settings, seed=seed)) for seed in (0, 1)]
    holes = [~np.isfinite(observation.depth_px[0]) for observation in both]
    np.testing.assert_array_equal(model.physics(settings, seeds=(0, 1)).ndp, np.mean(holes, 0))


def test_effects_are_transferred_onto_a_captured_reference(place):
    """An effect changes the captured images as it changes the simulated camera."""
    scene = capture.open_set(place / "null").scenes[0]
    alone, compared = (
        load_scene_model(scene, sensor(), against=against) for against in (None, scene)
    )
    base, captured = infrared(compared, {}), expect(compared.reference, StereoObservation)
    assert np.abs(base.left.astype(float) - captured.left).max() < 3
    assert sharpness(base.left) == pytest.approx(sharpness(captured.left), rel=0.03)
    valid, expected = (np.isfinite(each.ours_px).mean() for each in (base, captured))
    assert valid == pytest.approx(expected, abs=0.005)
    for settings in ({"gamma": 1.3}, {"quantisation": 10}, {"read_noise": 60.0}):
        transferred, simulated = (infrared(model, settings, seed=1) for model in (compared, alone))
        for image, expected in (
            (transferred.left, simulated.left),
            (transferred.right, simulated.right),
        ):
            assert image.mean() == pytest.approx(expected.mean(), rel=0.01)
            assert sharpness(image) == pytest.approx(sharpness(expected), rel=0.05)
        both = np.isfinite(transferred.ours_px) & np.isfinite(simulated.ours_px)
        assert both.mean() > 0.5
        assert np.median(np.abs(transferred.ours_px - simulated.ours_px)[both]) < 0.2


def sharpness(images: np.ndarray) -> float:
    return float(cv2.Laplacian(images[0].astype(np.float32), cv2.CV_32F).std())


def test_equal_renderings_are_shared(place, monkeypatch):
    model, fresh = (load(place / "null") for _ in range(2))
    count = []
    render = simulate.render_layers
    monkeypatch.setattr(
        simulate,
        "render_layers",
        lambda *args, **options: count.append(1) or render(*args, **options),
    )
    infrared(model, {"nir_reflectance": 0.5, "veil": 0.02})
    again = infrared(model, {"gamma": 1.2, "nir_reflectance": 0.5}, seed=1)
    assert len(count) == 1
    alone = infrared(fresh, {"nir_reflectance": 0.5, "gamma": 1.2}, seed=1)
    np.testing.assert_array_equal(again.left, alone.left)
    brighter = infrared(model, {"nir_reflectance": 1.5}, seed=1)
    assert len(count) == 3 and brighter.left.mean() > again.left.mean()


def test_a_capture_that_separates_two_effects_is_found(place):
    model = load(place / "null")
    menu = [
        proposal
        for proposal in MENU
        if proposal.cost == 1 and proposal.frames == 1 and Segment.IMAGE in proposal.segments
    ]
    veil = {"veil": 0.05}
    ranked = discriminate(model, {"vertical_offset": 0.5}, veil, Segment.IMAGE, menu=menu)
    assert ranked[0].enough and ranked[0].deviations >= ranked[-1].deviations
    equal = discriminate(model, veil, veil, Segment.IMAGE, menu=menu[:1])
    assert equal[0].deviations == pytest.approx(0) and not equal[0].enough
    assert discriminate(model, veil, {"exposure": -1.0}, Segment.IMAGE, menu=menu[:1]) == []


def test_bits_that_only_the_matcher_reads_are_separated_from_none(place):
    model = load(place / "null")
    longer = [proposal for proposal in MENU if "exposed twice" in proposal.text]
    base = sensor().left.dropped_bits
    (result,) = discriminate(model, {"dropped_bits": base + 2}, {}, Segment.DEPTH, menu=longer)
    assert result.deviations > 1
    (result,) = discriminate(model, {"dropped_bits": base}, {}, Segment.DEPTH, menu=longer)
    assert result.deviations == 0


def test_filters_off_separates_filters_from_the_matcher(place):
    model = load(place / "null")
    off = [proposal for proposal in MENU if "filters off" in proposal.text]
    rivals = [{"spatial_filter": 0.4}, {"hole_filling": "nearest"}, {"median": 0}]
    assert discriminate(model, *rivals[:2], Segment.DEPTH, menu=off)[0].deviations == 0
    assert discriminate(model, *rivals[1:], Segment.DEPTH, menu=off)[0].deviations > 1
    assert discriminate(model, *rivals[:2], Segment.IMAGE, menu=off) == []


def test_a_proposed_wall_has_the_light_of_the_scene(place):
    model = load(place / "null")
    wall = [proposal for proposal in MENU if "wall" in proposal.text]
    sunlight = {"sunlight": 5.0}
    assert discriminate(model, sunlight, {}, Segment.IMAGE, menu=wall)[0].enough
    shifted = {**sunlight, "model_shift": 0.002}  # An error of the reference, not of the wall.
    assert discriminate(model, sunlight, shifted, Segment.IMAGE, menu=wall)[0].deviations < 1e-9


@pytest.mark.long
def test_a_projector_that_a_capture_switches_off_stays_off(place):
    """Two projector powers look equal without the projector."""
    model = load(place / "null")
    dark = [
        proposal
        for proposal in MENU
        if "projector off" in proposal.text or "lens cap" in proposal.text
    ]
    rivals = ({"projector_power": 0.1}, {"projector_power": 0.2})
    results = discriminate(model, *rivals, Segment.IMAGE, menu=dark)
    assert len(results) == 2 and all(result.deviations == 0 for result in results)
    lit = [proposal for proposal in MENU if "lamp" in proposal.text]
    assert discriminate(model, *rivals, Segment.IMAGE, menu=lit)[0].deviations > 1
