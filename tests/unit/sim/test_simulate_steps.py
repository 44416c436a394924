"""Steps of a simulation on hand-made layers, without rendering: arguments reach their step."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

import starling
from starling.patterns import InputError
from starling.sim import simulate
from starling.sim.causes import geometric_causes, photometric_causes
from starling.sim.geometry.motion import STEP_PX
from starling.sim.reason import Reason
from starling.sim.render import indirect
from starling.sim.render.layers import Layers, Truth, ViewLayers
from starling.sim.scene.builtin import scenes
from starling.sim.scene.scene import Motion, Scene
from starling.sim.sensor.edits import with_values
from starling.sim.sensor.sensor import Sensor
from starling.sim.stereo.measurement import measure
from starling.sim.stereo.registration import register

SHAPE = (48, 128)
SHIFT_PX = 9
SCENE = scenes.wall(1.0)
SIZE = (
    *("width=128", "height=48", "fx_px=128", "fy_px=128", "cx_px=63.5", "cy_px=23.5"),
    "matcher.search_px=32",
)


@pytest.fixture(scope="module")
def sensor() -> Sensor:
    """Without speckle and flicker, of one exposure."""
    return with_values(
        starling.load_sensor("d435", edits=SIZE),
        [
            ("imager.auto_exposure_level", 0.0),
            ("imager.exposure_s", 0.01),
            ("projector.speckle_contrast", 0.0),
            ("projector.flicker", 0.0),
        ],
    )


@pytest.fixture(scope="module")
def layers(sensor: Sensor) -> Layers:
    """Dots of one disparity on a wall; half of the columns are unlit and hidden from the right."""
    depth_m = np.full(SHAPE, sensor.fx_px * sensor.baseline_m / SHIFT_PX, np.float32)
    rng = np.random.default_rng(0)
    dots = 0.2 + (rng.random((SHAPE[0], SHAPE[1] + SHIFT_PX)) < 0.2).astype(np.float32)

    def view(columns: slice) -> ViewLayers:
        light = np.ascontiguousarray(dots[:, columns])
        return ViewLayers(
            projector_direct=light,
            projector_indirect=np.zeros_like(light),
            ambient=np.full(SHAPE, 0.1, np.float32),
            other=np.zeros_like(light),
            depth_m=depth_m,
            body=np.ones(SHAPE, np.uint32),
        )

    near = np.broadcast_to(np.arange(SHAPE[1]) < 64, SHAPE)
    truth = Truth(
        depth_m=depth_m,
        normal=np.zeros((*SHAPE, 3), np.float32),
        material=np.ones(SHAPE, np.uint32),
        lit=near,
        right_sees=near,
    )
    return Layers(left=view(slice(0, 128)), right=view(slice(SHIFT_PX, None)), truth=truth)


@dataclasses.dataclass
class Renders:
    """Records the calls of the renderer, which returns the same layers each time."""

    layers: Layers
    calls: list[dict[str, Any]] = dataclasses.field(default_factory=list)
    indirect: list[dict[str, Any]] = dataclasses.field(default_factory=list)

    def direct(self, mi_scene: Any, sensor: Sensor, **options: Any) -> Layers:
        self.calls.append(options)
        return self.layers

    def add(self, layers: Layers, mi_scene: Any, sensor: Sensor, **options: Any) -> Layers:
        self.indirect.append(options)
        return layers


class Loaded:
    """Replaces a loaded scene."""

    count = 0

    def __init__(self, scene: Scene) -> None:
        Loaded.count += 1
        self.scene = scene

    def with_scene(self, scene: Scene) -> Loaded:
        assert scene is self.scene
        return self


@pytest.fixture
def renders(monkeypatch: pytest.MonkeyPatch, layers: Layers) -> Renders:
    record = Renders(layers)
    monkeypatch.setattr(simulate.direct, "layers", record.direct)
    monkeypatch.setattr(indirect, "add", record.add)
    monkeypatch.setattr(simulate, "MitsubaScene", Loaded)
    monkeypatch.setattr(Loaded, "count", 0)
    return record


def assert_equal(first: simulate.Shot, second: simulate.Shot) -> None:
    np.testing.assert_array_equal(first.ir_left, second.ir_left)
    np.testing.assert_array_equal(first.ir_right, second.ir_right)
    np.testing.assert_array_equal(first.depth.depth_m, second.depth.depth_m)
    np.testing.assert_array_equal(first.depth.reason, second.depth.reason)


@pytest.mark.parametrize("loaded", [False, True])
def test_simulate_renders_then_exposes(renders: Renders, sensor: Sensor, loaded: bool) -> None:
    scene: Any = Loaded(SCENE) if loaded else SCENE
    shot = simulate.simulate(scene, sensor, seed=3, frame=2)
    assert Loaded.count == 1
    assert_equal(shot, simulate.expose(renders.layers, SCENE, sensor, seed=3, frame=2))
    default = simulate.simulate(scene, sensor)
    assert_equal(default, simulate.expose(renders.layers, SCENE, sensor, seed=0, frame=0))
    assert_equal(default, simulate.expose(renders.layers, SCENE, sensor))
    assert (shot.ir_left != default.ir_left).any()
    assert shot.layers is renders.layers


@pytest.mark.parametrize("loaded", [False, True])
def test_a_sequence_renders_once_and_passes_the_history_on(
    renders: Renders, sensor: Sensor, loaded: bool
) -> None:
    filtered = with_values(sensor, [("post.temporal_alpha", 0.4)])
    scene: Any = Loaded(SCENE) if loaded else SCENE
    shots = list(simulate.sequence(scene, filtered, frames=3, seed=5))
    assert len(renders.calls) == 1 and len(shots) == 3 and Loaded.count == 1
    past = None
    for frame, shot in enumerate(shots):
        alone = simulate.expose(renders.layers, SCENE, filtered, seed=5, frame=frame, past=past)
        assert_equal(shot, alone)
        past = alone.depth.history
    (first,) = simulate.sequence(scene, sensor, frames=1)
    assert_equal(first, simulate.expose(renders.layers, SCENE, sensor, seed=0, frame=0))


def test_impossible_filters_are_refused_before_rendering(renders: Renders, sensor: Sensor) -> None:
    filtered = with_values(sensor, [("post.temporal_alpha", 0.4)])
    colourless = dataclasses.replace(with_values(sensor, [("post.registered", True)]), colour=None)
    with pytest.raises(InputError, match="must be 1 for a single frame"):
        simulate.simulate(SCENE, filtered)
    with pytest.raises(InputError, match="must be 1 for a single frame"):
        simulate.sequence(SCENE, filtered, frames=1)
    for frames in (1, 2):
        with pytest.raises(InputError, match="needs a colour camera"):
            simulate.refuse_impossible(colourless, frames)
    simulate.refuse_impossible(filtered, 2)
    assert renders.calls == [] and Loaded.count == 0


def test_depth_has_the_causes_of_scene_and_light(layers: Layers, sensor: Sensor) -> None:
    """The reading is the measurement of the matched pair with both kinds of causes."""
    pair = simulate.infrared(layers, SCENE, sensor, seed=4, frame=1)
    shot = simulate.expose(layers, SCENE, sensor, seed=4, frame=1)
    causes = geometric_causes(layers.truth, sensor) | photometric_causes(
        sensor.left, pair.electrons, pair.left, exposure_s=0.01
    )
    depth = measure(pair.matched_left, pair.matched_right, sensor, causes=causes)
    np.testing.assert_array_equal(shot.depth.reason, depth.reason)
    np.testing.assert_array_equal(shot.depth.depth_m, depth.depth_m)
    assert depth.valid.mean() > 0.5
    assert (shot.exposure_s, shot.gain) == (0.01, sensor.left.gain)
    np.testing.assert_array_equal(shot.ir_left, pair.left)
    np.testing.assert_array_equal(shot.ir_right, pair.right)


def test_the_noise_of_dark_current_is_that_of_the_exposure(layers: Layers, sensor: Sensor) -> None:
    """Too little light in a long exposure only: the dark current adds noise with time."""
    light = with_values(sensor, [("projector.power_w", 0.0), ("imager.exposure_s", 1e-3)])
    pair = simulate.infrared(layers, SCENE, light)
    seen = float(pair.electrons.mean())
    hot = with_values(light, [("imager.dark_current_e_s", 1e3 * seen**2)])
    reasons = [simulate.expose(layers, SCENE, device).depth.reason for device in (light, hot)]
    cold_count, hot_count = ((reason == Reason.LOW_SIGNAL).sum() for reason in reasons)
    assert hot_count > cold_count + 100


def test_depth_is_registered_if_requested(layers: Layers, sensor: Sensor) -> None:
    registered = with_values(sensor, [("post.registered", True)])
    shot = simulate.expose(layers, SCENE, registered)
    np.testing.assert_array_equal(shot.registered_m, register(shot.depth.depth_m, registered))
    assert simulate.expose(layers, SCENE, sensor).registered_m is None


def test_each_side_has_its_own_imager_and_light(layers: Layers, sensor: Sensor) -> None:
    """Charge follows the own view and imager; the matcher may read more bits than the driver."""
    assert layers.right is not None
    brighter = dataclasses.replace(
        layers, right=dataclasses.replace(layers.right, ambient=layers.left.ambient * 8)
    )
    black = dataclasses.replace(sensor.left, black_level_dn=40.0)
    device = dataclasses.replace(sensor, left=black)
    plain = simulate.infrared(layers, SCENE, device)
    pair = simulate.infrared(brighter, SCENE, device)
    np.testing.assert_array_equal(plain.left, pair.left)
    assert plain.right is not None and pair.right is not None
    assert pair.right.mean() > plain.right.mean() + 2
    assert plain.left.min() >= 30 > plain.right.min()
    np.testing.assert_array_equal(plain.electrons, pair.electrons)
    assert plain.electrons.shape == SHAPE


def test_one_imager_gives_one_image(layers: Layers, sensor: Sensor) -> None:
    pair = simulate.infrared(dataclasses.replace(layers, right=None), SCENE, sensor)
    assert pair.right is None and pair.matched_right is None
    np.testing.assert_array_equal(pair.left, simulate.infrared(layers, SCENE, sensor).left)


def test_exposure_control_averages_the_flicker(layers: Layers, sensor: Sensor) -> None:
    """Auto exposure gives all frames one exposure, and the flicker stays in the images."""
    steady = with_values(sensor, [("imager.auto_exposure_level", 0.2)])
    flickering = with_values(steady, [("projector.flicker", 0.3)])
    expected = simulate.infrared(layers, SCENE, steady).exposure
    assert expected.exposure_s != sensor.left.exposure_s
    pairs = [simulate.infrared(layers, SCENE, flickering, frame=frame) for frame in range(3)]
    assert {pair.exposure for pair in pairs} == {expected}
    assert len({float(pair.electrons.mean()) for pair in pairs}) == 3
    fixed = with_values(flickering, [("imager.auto_exposure_level", 0.0)])
    pairs = [simulate.infrared(layers, SCENE, fixed, frame=frame) for frame in range(2)]
    assert {pair.exposure.exposure_s for pair in pairs} == {sensor.left.exposure_s}


def test_seeds_and_frames_reach_light_optics_and_electronics(
    layers: Layers, sensor: Sensor
) -> None:
    """Light flickers and noise changes with seed and frame; speckle changes with the seed."""
    plain = simulate.infrared(layers, SCENE, sensor, seed=1, frame=1)
    for seed, frame in ((2, 1), (1, 2)):
        changed = simulate.infrared(layers, SCENE, sensor, seed=seed, frame=frame)
        assert (changed.left != plain.left).any() and (changed.right != plain.right).any()
        np.testing.assert_array_equal(changed.electrons, plain.electrons)
    default = simulate.infrared(layers, SCENE, sensor)
    first = simulate.infrared(layers, SCENE, sensor, seed=0, frame=0)
    np.testing.assert_array_equal(default.left, first.left)
    speckled = with_values(sensor, [("projector.speckle_contrast", 0.3)])
    first, second = (simulate.infrared(layers, SCENE, speckled, seed=seed) for seed in (1, 2))
    assert (first.electrons != second.electrons).any()
    flickering = with_values(sensor, [("projector.flicker", 0.3)])
    totals = {
        float(simulate.infrared(layers, SCENE, flickering, seed=seed, frame=frame).electrons.sum())
        for seed, frame in ((1, 0), (2, 0), (1, 1))
    }
    assert len(totals) == 3


def test_gain_of_auto_exposure_reaches_images_and_noise(layers: Layers, sensor: Sensor) -> None:
    """A dark scene: the image is as of a fixed exposure at the chosen gain."""
    automatic = with_values(
        sensor,
        [
            *[("imager.auto_exposure_level", 0.4), ("imager.auto_exposure_max_s", 1e-4)],
            ("left.auto_exposure_max_gain", 15.5),
        ],
    )
    shot = simulate.expose(layers, SCENE, automatic, seed=3)
    assert (shot.exposure_s, shot.gain) == (1e-4, 15.5)
    fixed = with_values(sensor, [("imager.exposure_s", 1e-4), ("imager.gain", 15.5)])
    expected = simulate.expose(layers, SCENE, fixed, seed=3)
    assert np.array_equal(shot.ir_left, expected.ir_left)
    assert np.array_equal(shot.ir_right, expected.ir_right)
    assert np.array_equal(shot.depth.reason, expected.depth.reason)
    assert np.array_equal(shot.depth.depth_m, expected.depth.depth_m, equal_nan=True)


@pytest.mark.parametrize(
    ("field", "inside", "outside"),
    [("samples", (1, 4096), (0, 4097)), ("seed", (0, 2**63 - 1), (-1, 2**63))],
)
def test_bounds_of_samples_and_seed(
    renders: Renders, sensor: Sensor, field: str, inside: tuple, outside: tuple
) -> None:
    scene: Any = Loaded(SCENE)
    for value in inside:
        simulate.render_layers(scene, sensor, **{field: value})
    for value in outside:
        with pytest.raises(InputError, match=f"{field} must be .*in .*; got {value}"):
            simulate.render_layers(scene, sensor, **{field: value})


def test_indirect_light_is_rendered_if_the_scene_has_it(renders: Renders, sensor: Sensor) -> None:
    simulate.render_layers(Loaded(SCENE), sensor)  # pyright: ignore[reportArgumentType]
    assert renders.indirect == []
    bounced = dataclasses.replace(SCENE, interreflection=0.5)
    simulate.render_layers(Loaded(bounced), sensor)  # pyright: ignore[reportArgumentType]
    simulate.simulate(bounced, sensor, seed=3, samples=7)
    list(simulate.sequence(bounced, sensor, frames=1, seed=4, samples=8))
    simulate.simulate(bounced, sensor)
    list(simulate.sequence(bounced, sensor, frames=1))
    assert renders.indirect == [
        {"samples": samples, "seed": seed}
        for samples, seed in ((16, 0), (7, 3), (8, 4), (16, 0), (16, 0))
    ]


def test_a_draft_has_one_position_a_pixel(renders: Renders, sensor: Sensor) -> None:
    simulate.simulate(SCENE, sensor, quality="draft")
    list(simulate.sequence(SCENE, sensor, frames=1, quality="draft"))
    simulate.simulate(SCENE, sensor)
    assert [call["subpixels"] for call in renders.calls] == [1, 1, 2]
    with pytest.raises(InputError, match="quality must be a known name; got 'fast'"):
        simulate.simulate(SCENE, sensor, quality="fast")  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize("moves", [False, True])
@pytest.mark.parametrize("automatic", [False, True])
def test_motion_lasts_as_long_as_the_exposure(
    renders: Renders, sensor: Sensor, moves: bool, automatic: bool
) -> None:
    """Auto exposure meters a still rendering first, if and only if the sensor moves."""
    level = 0.2 if automatic else 0.0
    device = with_values(sensor, [("imager.auto_exposure_level", level)])
    motion = Motion(velocity_m_s=(0.1, 0.0, 0.0)) if moves else Motion()
    scene = dataclasses.replace(SCENE, motion=motion)
    simulate.render_layers(Loaded(scene), device, seed=2)  # pyright: ignore[reportArgumentType]
    *metered, last = renders.calls
    assert metered == ([{"subpixels": 2}] if moves and automatic else [])
    exposure_s = simulate.infrared(renders.layers, scene, device, seed=2).exposure.exposure_s
    expected_s = exposure_s if moves and automatic else sensor.left.exposure_s
    assert last == {"subpixels": 2, "exposure_s": expected_s, "step_px": STEP_PX}
    simulate.render_layers(Loaded(scene), device, step_px=0.7)  # pyright: ignore
    assert renders.calls[-1]["step_px"] == 0.7
