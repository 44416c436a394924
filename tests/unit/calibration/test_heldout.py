"""Scores of simulated held-out scenes against real infrared images."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from starling.calibration import heldout, observation
from starling.calibration.observation import Observation
from starling.patterns.errors import InputError
from starling.sim.captures import capture, png
from starling.sim.render import emission
from starling.sim.scene import sources
from starling.sim.scene.scene import Scene
from starling.sim.sensor.edits import with_values
from starling.sim.sensor.sensor import Sensor
from starling.sim.simulate import simulate
from tests.unit.calibration import small_camera

WIDTH, HEIGHT = 400, 224


def _pattern(sensor: Sensor, folder: Path, name: str, flip: bool) -> Sensor:
    """Write the sensor's pattern to a file, optionally mirrored."""
    part = sensor.projector
    drawn = emission.pattern("d435", part.fov_x_deg, part.fov_y_deg, part.pattern_seed)
    image = drawn.image[:, ::-1] if flip else drawn.image
    code = np.rint(image * (65535 / image.max())).astype(np.uint16)
    (folder / name).write_bytes(png.encode(np.ascontiguousarray(code)))
    return with_values(sensor, [("projector.pattern", str(folder / name))])


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("heldout")


@pytest.fixture(scope="module")
def sensor(folder: Path) -> Sensor:
    return _pattern(small_camera.small("d435", WIDTH, HEIGHT), folder, "pattern.png", flip=False)


@pytest.fixture(scope="module")
def seen(sensor: Sensor, folder: Path) -> Observation:
    """Return a simulated scene read from files, with reflectance from its smoothed left image."""
    sensor = with_values(sensor, [("projector.pattern_scale", 1.002)])
    scene = dataclasses.replace(sources.load("tabletop:3", sensor), interreflection=0.0)
    shot = simulate(scene, sensor, seed=4)
    small_camera.write_info(folder / "set", sensor)
    truth_m, pair = shot.layers.truth.depth_m, (shot.ir_left, shot.ir_right)
    small_camera.write_scene(folder / "set" / "a", truth_m, pair, sensor)
    (scene_of_set,) = capture.open_set(folder / "set").scenes
    return observation.load(scene_of_set, sensor, smoothing_px=heldout.SMOOTHING_PX)


@pytest.fixture(scope="module")
def scored(seen: Observation, sensor: Sensor, folder: Path) -> heldout.SceneScore:
    control = _pattern(sensor, folder, "mirrored.png", flip=True)
    return heldout.score(seen, sensor, scale=1.002, mirrored=control)


def test_the_true_sensor_scores_high_and_its_mirror_by_chance(scored: heldout.SceneScore) -> None:
    """With the true sensor, noise, speckle and the mesh limit the score to about 0.9."""
    for side in ("left", "right"):
        assert float(np.median(scored.ncc[side])) > 0.9
        assert abs(float(np.median(scored.mirrored[side]))) < 0.05
    assert scored.scale == 1.002
    assert 0.6 < float(np.median(scored.ceiling)) <= 1


def test_a_wrong_scale_scores_less(
    seen: Observation, sensor: Sensor, scored: heldout.SceneScore
) -> None:
    wrong = heldout.score(seen, sensor, scale=0.99)
    assert np.median(wrong.ncc["left"]) < np.median(scored.ncc["left"]) - 0.05
    assert not wrong.mirrored


def test_simulated_images_are_noiseless_in_the_sensors_unit(
    seen: Observation, sensor: Sensor, scored: heldout.SceneScore
) -> None:
    """Images have the sensor's range and are deterministic."""
    again, depth = heldout.simulate(seen.stage, sensor, 1.002)
    np.testing.assert_array_equal(again["left"], scored.simulated["left"])
    assert again["left"].max() <= sensor.left.ceiling_dn
    ratio = float(again["left"].mean() / scored.real["left"].mean())
    assert 0.3 < ratio < 3
    assert depth["left"].shape == (HEIGHT, WIDTH)


def test_without_a_right_image_the_left_is_scored(seen: Observation, sensor: Sensor) -> None:
    left = heldout.score(dataclasses.replace(seen, right=None), sensor)
    assert set(left.ncc) == {"left"}
    assert not left.ceiling.size


@pytest.mark.parametrize("missing", ["left", "scene"])
def test_scenes_without_images_or_surface_are_refused(
    missing: str, seen: Observation, sensor: Sensor
) -> None:
    less = dataclasses.replace(seen, **{missing: None})
    with pytest.raises(InputError, match="held-out scene a must have infrared images") as caught:
        heldout.score(less, sensor)
    assert "Hold out another scene." in str(caught.value)
    assert isinstance(seen.scene, Scene)
