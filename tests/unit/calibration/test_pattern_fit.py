"""Fits of emitters to synthetic views, and their derivatives."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from starling.calibration.pattern import emission, emitter_model, pattern_fit
from starling.calibration.pattern.cosine_image import Grid
from starling.calibration.pattern.emission import RightAlignment
from starling.calibration.pattern.emitter_model import AbsorbedMotion, EmitterModel, PatternEmitter
from starling.calibration.pattern.lattice import Lattice
from starling.calibration.pattern.pattern_fit import PatternFit
from starling.calibration.pattern.unprojected import PatternImage
from starling.calibration.pattern.views import PatternView
from starling.sim.sensor import presets
from starling.sim.sensor.edits import with_values
from starling.sim.sensor.sensor import Sensor

WIDTH, HEIGHT, FOCAL_PX = 320, 192, 230.0
SCENES = {"near": 0.999, "middle": 1.0, "far": 1.001}
DEPTHS = {"near": (0.7, 0.5), "middle": (1.1, -0.4), "far": (1.8, 0.3)}
SHARED = (
    "emitter0.position.x",
    "emitter0.position.y",
    "emitter0.position.z",
    "emitter1.position.x",
    "emitter1.position.y",
    "emitter1.position.z",
    "pitch",
    "yaw",
    "right.offset_y",
    "right.offset_x",
    "right.roll",
    "right.focal_baseline",
)


def _sensor() -> Sensor:
    return with_values(
        presets.load("d415"),
        {
            "width": WIDTH,
            "height": HEIGHT,
            "fx_px": FOCAL_PX,
            "fy_px": FOCAL_PX,
            "cx_px": (WIDTH - 1) / 2,
            "cy_px": (HEIGHT - 1) / 2,
        }.items(),
    )


def _lattice(angle_deg: float, phase: tuple[float, float]) -> Lattice:
    """Return a lattice with a pitch of 32 mrad (7 px) and dots of 1.4 px."""
    angle = np.radians(angle_deg)
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    return Lattice(frequencies=turn / 0.032, phase=np.array(phase), sigma=6e-3)


def _truth() -> EmitterModel:
    return EmitterModel(
        emitters=(
            PatternEmitter(
                position_m=np.array([0.026, 1e-3, -5e-4]), source=_lattice(49.0, (0.1, -0.2))
            ),
            PatternEmitter(
                position_m=np.array([0.0305, 0.0, 1e-3]), source=_lattice(60.0, (0.4, 0.3))
            ),
        ),
        rotation_deg=(0.3, -0.2, 0.0),
        scales=SCENES,
        alignment=RightAlignment(offset_y=0.4, roll=0.3, offset_x=-0.3, focal_baseline=0.05),
    )


def _unlit(scene: str, side: str, sensor: Sensor) -> PatternView:
    """Return a view of a slanted surface without light."""
    depth, slant = DEPTHS[scene]
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    x, y = (x - sensor.cx_px) / FOCAL_PX, (y - sensor.cy_px) / FOCAL_PX
    z = depth * (1 + 0.3 * slant * x + slant * y) + 0.05 * np.sin(6 * x)
    points = np.stack([x * z + (sensor.baseline_m if side == "right" else 0), y * z, z], axis=-1)
    return PatternView(
        scene=scene,
        room=scene,
        side="right" if side == "right" else "left",
        level_dn=np.zeros((HEIGHT, WIDTH), np.float32),
        points_m=points.astype(np.float32),
        usable=np.ones((HEIGHT, WIDTH), bool),
    )


def _views(
    model: EmitterModel, sensor: Sensor, seed: int, shading: float = 0.3
) -> list[PatternView]:
    """Return noisy views with smoothly varying reflectance."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:HEIGHT, :WIDTH] / WIDTH
    views = []
    for scene in model.scales:
        for side in ("left", "right"):
            view = _unlit(scene, side, sensor)
            lights = emitter_model.illuminate(
                pattern_fit.surface_points(view, sensor), model, model.scales[scene]
            )
            light = 60 * lights[0].light + 40 * lights[1].light
            reflectance = 1 + shading * np.sin(3 * x + 2 * y)
            expected = (20 + light.reshape(HEIGHT, WIDTH)) * reflectance
            electron = sensor.left.dn_per_electron
            variance = electron * expected + (electron * sensor.left.read_noise_e) ** 2 + 1 / 12
            reading = expected + np.sqrt(variance) * rng.standard_normal(expected.shape)
            level = (reading + sensor.left.black_level_dn).astype(np.float32)
            views.append(dataclasses.replace(view, level_dn=level))
    return views


def _off(truth: EmitterModel) -> EmitterModel:
    """Return an initial model: 0.5 mm off, frequencies off by 1e-3, no alignment."""
    emitters = []
    for number, emitter in enumerate(truth.emitters):
        assert isinstance(emitter.source, Lattice)
        source = dataclasses.replace(
            emitter.source,
            frequencies=emitter.source.frequencies * 1.001,
            phase=emitter.source.phase + 0.03,
            sigma=5e-3,
        )
        position = emitter.position_m + np.array([5e-4, -5e-4, 3e-4 * (-1) ** number])
        emitters.append(PatternEmitter(position_m=position, source=source))
    return EmitterModel(
        emitters=tuple(emitters), rotation_deg=(0.0, 0.0, 0.0), scales=dict.fromkeys(SCENES, 1.0)
    )


def _value(model: EmitterModel, name: str) -> float:
    """Return a parameter of `SHARED`; rotations are small, so vectors are subtracted."""
    if name in emission.TURN:
        return float(np.radians(model.rotation_deg[emission.TURN.index(name)]))
    if name.startswith("right."):
        return float(model.alignment.as_vector()[emission.RIGHT.index(name.removeprefix("right."))])
    return float(model.emitters[int(name[7])].position_m["xyz".index(name[-1])])


@pytest.fixture(scope="module")
def sensor() -> Sensor:
    return _sensor()


@pytest.fixture(scope="module")
def fitted_pattern(sensor: Sensor) -> PatternFit:
    truth = _truth()
    return pattern_fit.fit(_views(truth, sensor, 0), sensor, _off(truth))


def test_all_parameters_are_recovered(fitted_pattern: PatternFit) -> None:
    """Errors are within four deviations, which are much smaller than the initial errors."""
    truth = _truth()
    for name in SHARED:
        assert abs(
            _value(fitted_pattern.model, name) - _value(truth, name)
        ) < 4 * fitted_pattern.sd(name), name
    for number in range(2):
        assert fitted_pattern.sd(f"emitter{number}.position.x") < 1e-4
    for scene, scale in SCENES.items():
        assert fitted_pattern.model.scales[scene] == pytest.approx(scale, abs=5e-5)
    for emitter, true in zip(fitted_pattern.model.emitters, truth.emitters, strict=True):
        assert isinstance(emitter.source, Lattice) and isinstance(true.source, Lattice)
        np.testing.assert_allclose(emitter.source.frequencies, true.source.frequencies, rtol=5e-4)
        assert emitter.source.sigma == pytest.approx(true.source.sigma, rel=0.02)


def test_signs_of_the_alignment(fitted_pattern: PatternFit) -> None:
    """Each alignment parameter has the correct sign, at more than ten deviations."""
    truth = _truth().alignment.as_vector()
    for name, true in zip(emission.RIGHT, truth, strict=True):
        value = _value(fitted_pattern.model, f"right.{name}")
        assert np.sign(value) == np.sign(true)
        assert abs(value) > 10 * fitted_pattern.sd(f"right.{name}")


def test_only_noise_remains(sensor: Sensor, fitted_pattern: PatternFit) -> None:
    """Without shading, the final cost is 1 within 2 %; shading within tiles increases it.

    Weights depend on noisy levels, which changes the cost by 0.5 %.
    """
    truth = _truth()
    even = pattern_fit.fit(_views(truth, sensor, 0, shading=0.0), sensor, truth, steps=1)
    assert even.cost[-1] == pytest.approx(1, abs=0.02)
    assert 1 < fitted_pattern.cost[-1] < 1.15
    assert fitted_pattern.cost[0] > 1.3 * fitted_pattern.cost[-1]


@pytest.mark.parametrize("steps", [1, 3])
def test_the_number_of_steps_is_limited(steps: int, sensor: Sensor) -> None:
    """From a distant initial model, all steps are used."""
    truth = _truth()
    fitted = pattern_fit.fit(_views(truth, sensor, 0), sensor, _off(truth), steps=steps)
    assert len(fitted.cost) == steps


def test_shares_are_the_emitters_shares_of_light(fitted_pattern: PatternFit) -> None:
    np.testing.assert_allclose(fitted_pattern.shares, [0.6, 0.4], atol=0.02)


def test_the_scenes_mean_scale_is_one(fitted_pattern: PatternFit) -> None:
    """The mean scale is confounded with the pattern's scale, so the gauge fixes it."""
    assert np.mean(list(fitted_pattern.model.scales.values())) == pytest.approx(1, abs=1e-6)


@pytest.mark.long
def test_intervals_cover_the_truth(sensor: Sensor) -> None:
    """Coverage of twelve parameters in eight draws is above 80 %, without overly wide intervals.

    Reference surfaces are exact; the test does not cover reference errors.
    """
    truth = _truth()
    scores = []
    for seed in range(1, 9):
        fitted = pattern_fit.fit(_views(truth, sensor, seed), sensor, truth)
        scores.append(
            [
                (_value(fitted.model, name) - _value(truth, name)) / fitted.sd(name)
                for name in SHARED
            ]
        )
    inside = np.abs(scores) < 1.645
    assert inside.mean() > 0.8
    assert np.sqrt(np.mean(np.square(scores))) > 0.4


def test_only_named_parameters_are_free(sensor: Sensor, fitted_pattern: PatternFit) -> None:
    truth = _truth()
    start = dataclasses.replace(truth, scales={**SCENES, "far": 1.0})
    fitted = pattern_fit.fit(
        _views(truth, sensor, 3), sensor, start, only=[emitter_model.scene_scale_name("far")]
    )
    assert fitted.model.scales["far"] == pytest.approx(SCENES["far"], abs=3e-5)
    assert fitted.model.scales["near"] == SCENES["near"]
    assert fitted.model.alignment == truth.alignment
    for emitter, true in zip(fitted.model.emitters, truth.emitters, strict=True):
        np.testing.assert_array_equal(emitter.position_m, true.position_m)


def _image_source() -> PatternImage:
    """Return a smooth pattern image."""
    grid = Grid(half_a=0.7, half_b=0.45, step=4e-3)
    a, b = grid.cosines()
    value = np.cos(2 * np.pi * 12 * a)[None, :] * np.cos(2 * np.pi * 9 * b)[:, None]
    flat = np.ones(grid.shape, np.float32)
    return PatternImage(grid=grid, value=value.astype(np.float32), sd=flat, views=flat)


@pytest.mark.parametrize("kind", ["lattice", "keystone", "image"])
def test_derivatives_match_differences(kind: str, sensor: Sensor) -> None:
    """Derivatives of one emitter's light match central differences of `illuminate`.

    The tolerance is 2 % of the largest difference, for the median pixel. Derivatives of an image
    are piecewise constant, and those of a lattice jump half-way between dots.
    """
    source = _image_source() if kind == "image" else _lattice(49.0, (0.1, -0.2))
    if isinstance(source, Lattice) and kind == "keystone":
        source = dataclasses.replace(source, keystone=np.array([0.02, -0.03]))
    model = dataclasses.replace(
        _truth(), emitters=(PatternEmitter(position_m=np.array([0.026, 1e-3, 0.0]), source=source),)
    )
    view = _unlit("near", "right", sensor)
    seen = pattern_fit.surface_points(view, sensor, 3)
    (laid,) = emitter_model.illuminate(seen, model, model.scales["near"])
    turns = "pitch" in model.names
    derivatives = emitter_model.derivatives(seen, "near", model.emitters[0], laid, 0, turns)
    steps = {"position": 2e-5, "frequency": 2e-3, "phase": 5e-4, "keystone": 2e-4, "sigma": 1e-5}
    others = {"pitch": 5e-5, "yaw": 5e-5, "pattern_scale": 5e-5, "right": 1e-2}
    names = [
        name for name in model.names if name not in ("pattern_scale[middle]", "pattern_scale[far]")
    ]
    assert set(derivatives) == set(names)
    for name in names:
        word = name.removeprefix("emitter0.").partition(".")[0].partition("[")[0]
        step = (steps | others)[word]
        ends = []
        for way in (step, -step):
            vector = np.array([way if candidate == name else 0.0 for candidate in model.names])
            moved = emitter_model.apply_step(model, vector)
            ends.append(emitter_model.illuminate(seen, moved, moved.scales["near"])[0].light)
        difference = (ends[0].astype(np.float64) - ends[1]) / (2 * step)
        off = np.abs(derivatives[name] - difference)
        assert np.median(off) < 0.02 * np.abs(difference).max(), name
        assert np.corrcoef(derivatives[name], difference)[0, 1] > 0.99, name


def test_absorbed_motion_is_subtracted(sensor: Sensor) -> None:
    """If the mean derivative equals that of a view, the remaining derivative is 0."""
    source = _image_source()
    seen = pattern_fit.surface_points(_unlit("near", "left", sensor), sensor, 3)
    model = dataclasses.replace(
        _truth(), emitters=(PatternEmitter(position_m=np.zeros(3), source=source),)
    )
    (laid,) = emitter_model.illuminate(seen, model, 1.0)
    partial = emitter_model.partials(seen, "near", laid.rays, 0)["emitter0.position.y"]
    middle = np.median(partial, axis=0)
    even = tuple(np.full(source.grid.shape, value, np.float32) for value in middle)
    follows = dataclasses.replace(
        model.emitters[0],
        absorbed=AbsorbedMotion(
            grid=source.grid, partials={"emitter0.position.y": (even[0], even[1])}
        ),
    )
    plain, less = (
        emitter_model.derivatives(seen, "near", emitter, laid, 0, False)
        for emitter in (model.emitters[0], follows)
    )
    expected = plain["emitter0.position.y"] - laid.slope @ middle
    np.testing.assert_allclose(less["emitter0.position.y"], expected, rtol=1e-4, atol=1e-3)
    np.testing.assert_array_equal(less["emitter0.position.x"], plain["emitter0.position.x"])
