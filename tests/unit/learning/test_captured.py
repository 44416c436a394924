"""Examples of a capture set: content, counted pixels, simulation and cache."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose, assert_array_equal

from starling.learning.data import captured, simulated
from starling.learning.data.captured import Simulation
from starling.learning.data.example import Example, Physics
from starling.patterns.errors import InputError
from starling.sim.captures import png
from starling.sim.captures.capture import CaptureSet, open_set
from starling.sim.scene.captured import captured_scene
from starling.sim.sensor.edits import with_values
from tests.unit.learning import capture_sets
from tests.unit.learning.step_scenes import SHAPE, step_scene

SENSOR = capture_sets.sensor()


@pytest.fixture
def captures(tmp_path: Path) -> CaptureSet:
    return open_set(capture_sets.write(tmp_path / "set"))


@pytest.fixture
def calls(monkeypatch: pytest.MonkeyPatch) -> list[dict]:
    """Replace the simulation by synthetic physics; returns the recorded calls."""
    calls: list[dict] = []

    def built(scene: object, sensor: object, **how: object) -> Physics:
        calls.append({"scene": scene, "sensor": sensor, **how})
        result = step_scene(len(calls)).physics
        assert result is not None
        return result

    monkeypatch.setattr(simulated, "physics", built)
    return calls


def _same(item: Physics, different: Physics) -> None:
    for field in dataclasses.fields(Physics):
        first, second = getattr(item, field.name), getattr(different, field.name)
        assert_array_equal(first, second)
        assert np.asarray(first).dtype == np.asarray(second).dtype


def test_examples_have_the_content_of_the_files(captures):
    result = captured.examples(captures)
    assert [example.scene for example in result] == list(capture_sets.SCENES)
    assert [example.room for example in result] == list(capture_sets.ROOMS)
    for number, example in enumerate(result):
        truth_m, ndp, _ = capture_sets.drawn(number)
        known = np.ones(SHAPE, bool)
        known[capture_sets.UNKNOWN] = False
        assert example.info == captures.info
        assert_allclose(example.depth_m[known], truth_m[known], atol=5.1e-4)  # Half a step.
        assert_array_equal(np.isfinite(example.depth_m), known)
        assert_array_equal(example.ndp, ndp)
        assert example.physics is None


def test_counted_pixels_are_right_of_the_left_band_with_known_reference(captures):
    counted = captured.examples(captures)[0].counted
    assert counted is not None
    assert not counted[:, : capture_sets.LEFT_BAND].any()
    assert not counted[capture_sets.UNKNOWN].any()
    assert counted[capture_sets.UNKNOWN.stop :, capture_sets.LEFT_BAND :].all()


def test_rooms_are_selected_and_unknown_rooms_refused(captures):
    result = captured.examples(captures, rooms=("study", "cellar"))
    assert [example.room for example in result] == ["cellar", "study"]
    with pytest.raises(InputError, match=r"^room must be a known name; got 'yard'\. Known: "):
        captured.examples(captures, rooms=("attic", "yard"))


def test_a_scene_without_depth_is_refused(captures):
    scene = captures.scenes[1]
    (scene.path / "0/depth.png").unlink()
    line = "scene cellar-view must have the device's depth; got no depth.png. Leave it out, or"
    with pytest.raises(InputError, match=line):
        captured.example(scene)
    (scene.path / "truth.png").unlink()
    with pytest.raises(InputError, match=line):
        captured.surface(scene, SENSOR, even=True)


def test_without_truth_the_reference_is_estimated(captures):
    """Holes are still those of the device, and the estimate is near the truth."""
    scene = captures.scenes[1]
    known = captured.example(scene)
    (scene.path / "truth.png").unlink()
    with pytest.warns(UserWarning, match="^1 of 4 scenes have no truth.png, cellar-view first"):
        estimated = captured.examples(captures)[1]
    assert_array_equal(estimated.ndp, known.ndp)
    both = np.isfinite(estimated.depth_m) & np.isfinite(known.depth_m)
    assert both.mean() > 0.8
    info = captures.info
    off_px = info.disparity_px(estimated.depth_m) - info.disparity_px(known.depth_m)
    assert np.quantile(np.abs(off_px[both]), 0.9) < 0.2


def test_without_infrared_an_example_has_no_reflectance(captures):
    for name in ("ir_left", "ir_right"):
        (captures.scenes[0].path / "0" / f"{name}.png").unlink()
    assert captured.example(captures.scenes[0]).reflectance is None
    line = r"^scene must have truth\.png and ir_left\.png; got .*attic-view\. Choose a scene with"
    for requests in (
        lambda scene: captured_scene.brightness(scene, smoothing_px=2.0),
        lambda scene: captured_scene.estimate_light(scene, SENSOR),
    ):
        with pytest.raises(InputError, match=line):
            requests(captures.scenes[0])
    (captures.scenes[1].path / "truth.png").unlink()
    with pytest.raises(InputError, match=r"^scene must have truth\.png"):
        captured_scene.estimate_light(captures.scenes[1], SENSOR)


def test_brightness_is_the_smoothed_level_over_its_mean(captures):
    """Half of 44 DN and half of 24 DN above black, far from the step: 0.5 times 40 and 20 over 30.

    Brightness is not reflectance in a real scene, because an image also depends on the light.
    """
    scene = captures.scenes[0]
    image = np.full(SHAPE, 44, np.uint8)
    image[:, SHAPE[1] // 2 :] = 24
    (scene.path / "0" / "ir_left.png").write_bytes(png.encode(image))
    result = captured_scene.brightness(scene, smoothing_px=2.0)
    assert result.dtype == np.float32
    assert_allclose(result[:, :20], 0.5 * 40 / 30, rtol=1e-3)
    assert_allclose(result[:, -20:], 0.5 * 20 / 30, rtol=1e-3)
    assert result.mean() == pytest.approx(0.5, rel=1e-5)


def test_smoothing_leaves_no_dot_in_an_example(captures):
    """Single-pixel dots deviate by 0.6 of the mean; after a Gaussian of 12 px about 1 % remains."""
    reflectance = captured.examples(captures)[0].reflectance
    assert reflectance is not None
    sharp = capture_sets.drawn(0)[2].astype(float) - 4
    assert sharp.std() / sharp.mean() > 0.5
    assert np.abs(np.diff(reflectance, axis=1)).max() < 0.01


def test_even_scenes_have_one_reflectance(captures):
    scene = captures.scenes[0]
    seen = captured.surface(scene, SENSOR)
    even = captured.surface(scene, SENSOR, even=True)
    assert any(body.texture is not None for body in seen.bodies)
    assert all(body.texture is None for body in even.bodies)
    assert {body.material.reflectance for body in even.bodies} == {0.5}
    for item, second in zip(seen.bodies, even.bodies, strict=True):
        assert_array_equal(item.mesh.vertices, second.mesh.vertices)
    (scene.path / "0" / "ir_left.png").unlink()
    (scene.path / "0" / "ir_right.png").unlink()
    without = captured.surface(scene, SENSOR, even=True)  # Reads no image.
    assert_array_equal(without.bodies[0].mesh.vertices, even.bodies[0].mesh.vertices)


def test_known_geometry_is_simulated(captures):
    scene = captures.scenes[0]
    rows = (
        "[[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]"
    )
    (scene.path / "scene.toml").write_text(f'scene = "wall:1.5"\nleft_from_world = {rows}\n')
    for even in (False, True):
        result = captured.surface(scene, SENSOR, even=even)
        assert [body.name for body in result.bodies] == ["wall"]


def test_cached_physics_is_bit_identical(captures, tmp_path):
    scene = captures.scenes[0]
    fresh = captured.example(scene, simulation=Simulation(sensor=SENSOR, draws=2)).physics
    keeping = Simulation(sensor=SENSOR, draws=2, cache=tmp_path / "kept")
    first, again = (captured.example(scene, simulation=keeping).physics for _ in range(2))
    assert fresh is not None and first is not None and again is not None
    assert 0 < fresh.ndp.mean() < 1
    _same(fresh, first)
    _same(fresh, again)


def test_cached_physics_is_not_simulated_again(captures, calls, tmp_path):
    simulation = Simulation(sensor=SENSOR, draws=3, cache=tmp_path / "kept")
    first = captured.examples(captures, simulation=simulation)
    assert len(calls) == 4
    again = captured.examples(captures, simulation=simulation)
    assert len(calls) == 4
    for item, second in zip(first, again, strict=True):
        assert item.physics is not None and second.physics is not None
        _same(item.physics, second.physics)
    elsewhere = dataclasses.replace(simulation, cache=tmp_path / "other")
    captured.example(captures.scenes[0], simulation=elsewhere)
    names = {path.name for path in (tmp_path / "kept").iterdir()}
    assert len(names) == 4
    # Independent of the folder.
    assert {path.name for path in (tmp_path / "other").iterdir()} < names


def test_scenes_have_independent_draws(captures, calls):
    captured.examples(captures, simulation=Simulation(sensor=SENSOR, draws=3, seed=5))
    assert {call["draws"] for call in calls} == {3}
    assert len({call["seed"] for call in calls}) == 4


@pytest.mark.parametrize("even", [False, True])
def test_the_simulation_uses_scene_and_sensor(captures, calls, even):
    captured.example(captures.scenes[0], simulation=Simulation(sensor=SENSOR, even=even))
    (call,) = calls
    assert call["sensor"] is SENSOR
    assert {body.texture is None for body in call["scene"].bodies} == {even}


def _with_pattern(path: Path) -> Simulation:
    return Simulation(sensor=with_values(SENSOR, [("projector.pattern", str(path))]))


@pytest.mark.parametrize(
    "changed",
    [
        {"draws": 9},
        {"seed": 1},
        {"even": True},
        {"sensor": with_values(SENSOR, [("projector.power_w", 1.1)])},
        {"sensor": with_values(SENSOR, [("imager.gain", 2.0)])},
    ],
)
def test_other_settings_have_other_cache_keys(captures, calls, tmp_path, changed):
    plain = Simulation(sensor=SENSOR, cache=tmp_path / "kept")
    scene = captures.scenes[0]
    captured.example(scene, simulation=plain)
    captured.example(scene, simulation=dataclasses.replace(plain, **changed))
    assert len(calls) == 2
    assert len(list((tmp_path / "kept").iterdir())) == 2
    captured.example(scene, simulation=plain)
    assert len(calls) == 2


def test_a_changed_mesh_file_invalidates_the_cache(captures, calls, tmp_path):
    scene, simulation = captures.scenes[0], Simulation(sensor=SENSOR, cache=tmp_path / "kept")
    rows = ", ".join(str([float(i == j) for j in range(4)]) for i in range(4))
    (scene.path / "scene.toml").write_text(f'scene = "body.ply"\nleft_from_world = [{rows}]\n')
    for size in (0.2, 0.3):
        trimesh.creation.box((size, size, size)).export(scene.path / "body.ply")
        captured.example(scene, simulation=simulation)
    assert len(calls) == 2


@pytest.mark.parametrize("name", ["truth.png", "0/ir_left.png", "scene.toml"])
def test_a_changed_scene_invalidates_the_cache(captures, calls, tmp_path, name):
    scene, simulation = captures.scenes[0], Simulation(sensor=SENSOR, cache=tmp_path / "kept")
    captured.example(scene, simulation=simulation)
    path = scene.path / name
    if name == "scene.toml":
        rows = ", ".join(str([float(i == j) for j in range(4)]) for i in range(4))
        path.write_text(f'scene = "wall"\nleft_from_world = [{rows}]\n')
    else:
        image = png.read(path, "image").copy()
        image[10, 30] += 1
        path.write_bytes(png.encode(image))
    captured.example(scene, simulation=simulation)
    assert len(calls) == 2


def test_a_changed_pattern_file_invalidates_the_cache(captures, calls, tmp_path):
    path = tmp_path / "dots.png"
    for number in (1, 2):
        path.write_bytes(png.encode(np.full((32, 32), 100 + number, np.uint8)))
        simulation = dataclasses.replace(_with_pattern(path), cache=tmp_path / "kept")
        captured.example(captures.scenes[0], simulation=simulation)
        assert len(calls) == number


def _holes(share: float, counted: float) -> Example:
    ndp = np.zeros(SHAPE, bool)
    ndp[: round(share * counted * SHAPE[0])] = True
    where = np.zeros(SHAPE, bool)
    where[: round(counted * SHAPE[0])] = True
    return dataclasses.replace(step_scene(0), ndp=ndp, counted=where)


def test_the_share_of_holes_is_the_mean_over_scenes():
    """Scenes with a quarter and with all pixels count equally: 0.5 and 0.25 average to 0.375."""
    assert captured.ndp_rate([_holes(0.5, 0.25), _holes(0.25, 1.0)]) == pytest.approx(0.375)
    nothing = dataclasses.replace(step_scene(0), counted=np.zeros(SHAPE, bool))
    with pytest.raises(InputError, match="scene scene0 must have reference depth"):
        captured.ndp_rate([nothing])


def test_an_existing_cache_folder_is_kept(tmp_path):
    plain = Simulation(sensor=SENSOR)
    remaining = captured.caching(plain, tmp_path / "one")
    assert remaining.cache == tmp_path / "one"
    assert captured.caching(remaining, tmp_path / "two") is remaining


@pytest.mark.parametrize(
    ("field", "value"), [("kind", "structured_light"), ("width", SENSOR.width + 16)]
)
def test_a_simulated_sensor_of_another_camera_is_refused(captures, field, value):
    place = (SENSOR.baseline_m, 0.0, 0.0)
    edits = [(field, value), ("projector.position_m", place)]
    simulation = Simulation(sensor=with_values(SENSOR, edits), draws=2)
    with pytest.raises(InputError, match=r"sensor must (be a stereo camera's|have images of)"):
        captured.example(captures.scenes[0], simulation=simulation)
