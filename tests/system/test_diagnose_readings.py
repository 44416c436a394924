"""What is read of captures that are diagnosed, how their scenes are simulated, what would tell."""

from __future__ import annotations

import dataclasses
import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from starling.diagnosis.scenes import observation, scene_model
from starling.diagnosis.scenes import stability as moved
from starling.diagnosis.validation.adapters import light_sets
from starling.diagnosis.validation.protocol import case, shoot
from starling.diagnosis.which.candidates import Arm
from starling.diagnosis.which.discrimination import MENU, tell_apart
from starling.sim import simulate
from starling.sim.captures import capture
from starling.sim.commands import simulate_captures
from starling.sim.sensor.edits import with_values
from tests.system.test_diagnose import SCENES, sensor


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two repeats of one scene by a camera that nothing was done to."""
    folder = tmp_path_factory.mktemp("readings")
    light_sets.write(folder / "light", SCENES[:1], sensor())
    one = case.Case(number=0, kind="null", settings={}, seed=7)
    shoot.shoot(folder / "light", one, folder / "null", frames=2)
    return folder


def test_of_repeats_as_many_are_taken_as_there_are_of_all(place, tmp_path):
    fewer = shutil.copytree(place / "null", tmp_path / "fewer")
    (fewer / "clutter-1" / "1" / "ir_right.png").unlink()
    two, one = (capture.open_set(of).scenes[0] for of in (place / "null", fewer))
    first, second = observation.alike(*(observation.read(of, sensor()) for of in (two, one)))
    assert first.repeats == second.repeats == 1
    assert observation.read(two, sensor()).repeats == 2
    assert scene_model.subject(one, sensor()).frames == 1


def test_images_of_more_bits_are_matched_as_such(place):
    scene = capture.open_set(place / "null").scenes[0]
    seen = observation.read(scene, sensor())
    deep = [image.astype(np.uint16) << 4 for image in (seen.left, seen.right)]
    found = observation.matched(deep[0][:1], deep[1][:1], sensor())
    both = np.isfinite(found) & np.isfinite(seen.ours_px)
    assert both.mean() > 0.6 and np.median(np.abs(found - seen.ours_px)[both]) < 0.1


def test_a_simulated_capture_has_other_noise_than_what_it_is_compared_with(place):
    """Else what noise makes would be no gap where captures come of `starling simulate`."""
    scene = capture.open_set(place / "null").scenes[0]
    one = scene_model.subject(scene, sensor())
    seed = simulate_captures.scene_seed(0, one.name)
    layers = simulate.rendered(one._stage, sensor(), samples=4)
    taken = simulate.infrared(layers, one.scene, sensor(), seed=seed).left
    still = with_values(sensor(), [("imager.shot_noise", 0.0), ("imager.read_noise_e", 0.0)])
    mean = simulate.infrared(layers, one.scene, still).left.astype(float)
    simulated = one.simulate({}, seed=0).left
    assert simulated is not None
    noise = [(image - mean).ravel() for image in (taken, simulated[0])]
    spread = [float(np.std(image)) for image in noise]
    assert min(spread) > 0.3 and spread[0] == pytest.approx(spread[1], rel=0.1)
    quantised = np.corrcoef([(image - mean).ravel() for image in simulated])[0, 1]
    assert abs(np.corrcoef(noise)[0, 1] - quantised) < 0.05


def test_pairs_without_the_projector_are_read_where_it_is_off(place, tmp_path):
    """And no depth with them, which is of the others; where there are none the pairs there are."""
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
    on, seen = observation.read(scene, sensor()), observation.read(scene, off)
    assert on.device_px is not None and on.repeats == 2
    assert seen.device_px is None and seen.repeats == 1
    assert on.left is not None and seen.left is not None
    np.testing.assert_array_equal(seen.left[0], on.left[0] // 2)
    plain = capture.open_set(place / "null").scenes[0]
    assert observation.read(plain, off).repeats == 2


def sensor_shape(captures: Path) -> tuple[int, int]:
    return capture.open_set(captures).info.shape


def test_steps_of_time_are_no_repeats(place, tmp_path):
    steps = shutil.copytree(place / "null", tmp_path / "steps")
    scene = capture.open_set(steps).scenes[0]
    assert observation.read(scene, sensor()).repeats == 2
    (scene.path / "0" / "frame.json").write_text(json.dumps({"counts": "steps of time"}))
    assert observation.read(scene, sensor()).repeats == 1


def test_repeats_that_moved_are_noticed(place):
    """A pixel to the side; not noise, nor a fifth more light."""
    left = observation.read(capture.open_set(place / "null").scenes[0], sensor()).left
    assert left is not None
    first, second = left
    brighter = np.clip(second * 1.2, 0, 255).astype(np.uint8)
    assert not moved.images(left) and not moved.images(np.stack([first, brighter]))
    assert moved.images(np.stack([first, np.roll(second, 1, axis=1)]))


def test_repeats_that_moved_are_told_of_and_read(place, tmp_path):
    shaken = shutil.copytree(place / "null", tmp_path / "shaken")
    path = shaken / "clutter-1" / "1" / "ir_left.png"
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert image is not None
    cv2.imwrite(str(path), np.roll(image, 1, axis=1))
    read = observation.read(capture.open_set(shaken).scenes[0], sensor())
    assert read.moved and read.repeats == 2
    still = observation.read(capture.open_set(place / "null").scenes[0], sensor())
    assert not still.moved and still.repeats == 2


def test_a_body_that_moved_is_noticed_in_depth_alone(place, tmp_path):
    """Not noise, nor depth that is all noise, nor repeats that have none in common."""
    alone = shutil.copytree(place / "null", tmp_path / "alone")
    folder = alone / "clutter-1"
    for path in folder.glob("*/ir_*.png"):
        path.unlink()
    rng = np.random.default_rng(0)
    info = capture.open_set(alone).info
    disparity_px = 30 + 0.1 * rng.standard_normal((2, *info.shape))

    def read(of: NDArray[np.float64]) -> observation.Reading:
        code = np.where(of > 0, info.fx_px * info.baseline_m / of / info.depth_unit_m, 0)
        for number, one in enumerate(np.rint(code).astype(np.uint16)):
            cv2.imwrite(str(folder / str(number) / "depth.png"), one)
        return observation.read(capture.open_set(alone).scenes[0], sensor())

    assert not read(disparity_px).moved
    beside = disparity_px.copy()
    beside[1, 40:80, 60:120] += 3
    assert read(beside).moved
    assert not read(30 + 3 * rng.standard_normal(beside.shape)).moved
    half = np.arange(info.width) < info.width // 2
    apart = np.stack([np.where(half, 30.0, -1.0), np.where(half, -1.0, 30.0)])
    assert not read(np.repeat(apart[:, None], info.height, axis=1)).moved


def test_what_is_learnt_from_are_the_holes_that_how_far_is_told_of(place):
    finer = with_values(sensor(), [("imager.dropped_bits", 2)])
    one = scene_model.subject(capture.open_set(place / "null").scenes[0], finer)
    settings = {"interreflection": 0.0, "veil": 0.02}
    images = [~np.isfinite(one.simulate(settings, seed=seed).ours_px[0]) for seed in (0, 1)]
    np.testing.assert_array_equal(one.physics(settings, seeds=(0, 1)).ndp, np.mean(images, 0))
    one.real = dataclasses.replace(one.real, device_px=one.real.ours_px)
    own = [~np.isfinite(one.capture(settings, seed=seed).device_px[0]) for seed in (0, 1)]
    np.testing.assert_array_equal(one.physics(settings, seeds=(0, 1)).ndp, np.mean(own, 0))


def test_beside_other_captures_effects_are_laid_onto_those(place):
    """What an effect does to a capture's own images is what the effect does to the camera."""
    scene = capture.open_set(place / "null").scenes[0]
    alone, beside = (scene_model.subject(scene, sensor(), against=one) for one in (None, scene))
    base, captured = beside.simulate({}, seed=0), beside.against
    assert captured is not None
    assert np.abs(base.left.astype(float) - captured.left).max() < 3
    assert sharpness(base.left) == pytest.approx(sharpness(captured.left), rel=0.03)
    found, wanted = (np.isfinite(one.ours_px).mean() for one in (base, captured))
    assert found == pytest.approx(wanted, abs=0.005)
    for settings in ({"gamma": 1.3}, {"quantisation": 10}, {"read_noise": 60.0}):
        laid, simulated = (one.simulate(settings, seed=1) for one in (beside, alone))
        for found, wanted in ((laid.left, simulated.left), (laid.right, simulated.right)):
            assert found.mean() == pytest.approx(wanted.mean(), rel=0.01)
            assert sharpness(found) == pytest.approx(sharpness(wanted), rel=0.05)
        both = np.isfinite(laid.ours_px) & np.isfinite(simulated.ours_px)
        assert both.mean() > 0.5
        assert np.median(np.abs(laid.ours_px - simulated.ours_px)[both]) < 0.2


def sharpness(images: np.ndarray) -> float:
    return float(cv2.Laplacian(images[0].astype(np.float32), cv2.CV_32F).std())


def test_what_does_not_differ_is_rendered_once(place, monkeypatch):
    scene = capture.open_set(place / "null").scenes[0]
    one, fresh = (scene_model.subject(scene, sensor()) for _ in range(2))
    count = []
    render = simulate.rendered
    monkeypatch.setattr(
        simulate, "rendered", lambda *of, **how: count.append(1) or render(*of, **how)
    )
    one.simulate({"nir_reflectance": 0.5, "veil": 0.02}, seed=0)
    again = one.simulate({"gamma": 1.2, "nir_reflectance": 0.5}, seed=1)
    assert len(count) == 1
    alone = fresh.simulate({"nir_reflectance": 0.5, "gamma": 1.2}, seed=1)
    np.testing.assert_array_equal(again.left, alone.left)
    brighter = one.simulate({"nir_reflectance": 1.5}, seed=1)
    assert len(count) == 3 and brighter.left.mean() > again.left.mean()


def test_a_capture_that_tells_is_found(place):
    """Noise in electrons against light on the dark level: a lens cap takes the one away."""
    scene = capture.open_set(place / "null").scenes[0]
    one = scene_model.subject(scene, sensor())
    menu = [
        proposal
        for proposal in MENU
        if proposal.cost == 1 and proposal.frames == 1 and Arm.IMAGE in proposal.arms
    ]
    told = tell_apart(one, {"vertical_offset": 0.5}, {"veil": 0.05}, Arm.IMAGE, menu=menu)
    assert told[0].enough and told[0].deviations >= told[-1].deviations
    same = tell_apart(one, {"veil": 0.05}, {"veil": 0.05}, Arm.IMAGE, menu=menu[:1])
    assert same[0].deviations == pytest.approx(0) and not same[0].enough
    assert tell_apart(one, {"veil": 0.05}, {"exposure": -1.0}, Arm.IMAGE, menu=menu[:1]) == []


def test_bits_that_a_matcher_alone_reads_are_told_from_none(place):
    one = scene_model.subject(capture.open_set(place / "null").scenes[0], sensor())
    as_is = [each for each in MENU if "exposed twice" in each.text]
    base = sensor().left.dropped_bits
    (told,) = tell_apart(one, {"dropped_bits": base + 2}, {}, Arm.DEPTH, menu=as_is)
    assert told.deviations > 1
    (told,) = tell_apart(one, {"dropped_bits": base}, {}, Arm.DEPTH, menu=as_is)
    assert told.deviations == 0


def test_filters_that_are_off_tell_them_from_the_matcher(place):
    one = scene_model.subject(capture.open_set(place / "null").scenes[0], sensor())
    off = [each for each in MENU if "filters off" in each.text]
    rivals = [{"spatial_filter": 0.4}, {"hole_filling": "nearest"}, {"median": 0}]
    assert tell_apart(one, *rivals[:2], Arm.DEPTH, menu=off)[0].deviations == 0
    assert tell_apart(one, *rivals[1:], Arm.DEPTH, menu=off)[0].deviations > 1
    assert tell_apart(one, *rivals[:2], Arm.IMAGE, menu=off) == []


def test_at_a_wall_the_camera_moves_and_light_is_as_in_the_scene(place):
    one = scene_model.subject(capture.open_set(place / "null").scenes[0], sensor())
    wall = [each for each in MENU if "wall" in each.text]
    assert tell_apart(one, {"sunlight": 5.0}, {}, Arm.IMAGE, menu=wall)[0].enough
    moved = {"sunlight": 5.0, "model_shift": 0.002}  # Where the scene truly stands stays with it.
    assert tell_apart(one, {"sunlight": 5.0}, moved, Arm.IMAGE, menu=wall)[0].deviations < 1e-9


def test_what_a_capture_switches_off_no_rival_switches_on(place):  # Two powers look the same.
    one = scene_model.subject(capture.open_set(place / "null").scenes[0], sensor())
    dark = [each for each in MENU if "projector off" in each.text or "lens cap" in each.text]
    rivals = ({"projector_power": 0.1}, {"projector_power": 0.2})
    told = tell_apart(one, *rivals, Arm.IMAGE, menu=dark)
    assert len(told) == 2 and all(each.deviations == 0 for each in told)
    lit = [each for each in MENU if "lamp" in each.text]
    assert tell_apart(one, *rivals, Arm.IMAGE, menu=lit)[0].deviations > 1
