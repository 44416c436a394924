"""Conversion of a recovered pattern to a sensor's parameters, with uncertainty."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from starling.calibration.pattern import emitter_model, pattern_sensor, pattern_solution
from starling.calibration.pattern.cosine_image import Grid
from starling.calibration.pattern.emission import RightAlignment
from starling.calibration.pattern.emitter_model import EmitterModel, PatternEmitter
from starling.calibration.pattern.lattice import Lattice
from starling.calibration.pattern.pattern_fit import PatternFit
from starling.calibration.pattern.recovery import RecoveredPattern
from starling.calibration.pattern.unprojected import PatternImage
from starling.calibration.solution import Solution
from starling.sim.sensor import edits, presets
from starling.sim.sensor.projector import Emitter
from starling.sim.sensor.sensor import Sensor

SCENES = {"kitchen": 0.999, "hall": 1.001}
GRID = Grid(half_a=0.6, half_b=0.4, step=0.01)


def _image() -> PatternImage:
    flat = np.zeros(GRID.shape, np.float32)
    return PatternImage(grid=GRID, value=flat, sd=flat + 1, views=flat + 1)


def _lattice(angle_deg: float) -> Lattice:
    angle = np.radians(angle_deg)
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    return Lattice(frequencies=turn / 0.0123, phase=np.array([0.1, 0.2]), sigma=2e-3)


def _model(*sources: Lattice | PatternImage) -> EmitterModel:
    return EmitterModel(
        emitters=tuple(
            PatternEmitter(position_m=np.array([0.026 + 0.004 * k, 1e-3 * k, -1e-3]), source=source)
            for k, source in enumerate(sources)
        ),
        rotation_deg=(0.4, -0.3, 0.2),
        scales=SCENES,
        alignment=RightAlignment(offset_y=0.4, roll=0.8, offset_x=0.3, focal_baseline=0.09),
    )


def _recovered(model: EmitterModel, seed: int = 0, rooms: int = 3) -> RecoveredPattern:
    rng = np.random.default_rng(seed)
    count = len(model.names)
    root = rng.standard_normal((count, count)) * 1e-4
    fitted = PatternFit(
        model=model,
        covariance=root @ root.T,
        cost=(2.0, 1.0),
        shares=np.full(len(model.emitters), 1 / len(model.emitters)),
        rooms=rooms,
    )
    return RecoveredPattern(fitted=fitted, image=_image())


def _solution(model: EmitterModel, sensor: Sensor, *, metric: bool = False) -> Solution:
    return pattern_solution.solution(_recovered(model), sensor, metric=metric)


@pytest.fixture(scope="module")
def sensor() -> Sensor:
    """A D415 with a nonzero initial alignment."""
    return edits.with_values(
        presets.load("d415"),
        [("right.alignment.offset_y_px", 0.1), ("right.alignment.roll_deg", 0.02)],
    )


MODELS = {
    "lattices": _model(_lattice(49.0), _lattice(60.0)),
    "lattice": _model(_lattice(49.0)),
    "image": _model(_image()),
}


@pytest.mark.parametrize("kind", list(MODELS))
def test_the_covariance_matches_numerical_derivatives(kind: str, sensor: Sensor) -> None:
    """The covariance matches that from numerical derivatives of the estimates.

    Offsets of emitters use fixed axes of the projector. Their derivative by the rotation, a few
    micrometres per milliradian, is neglected here as well.
    """
    model = MODELS[kind]
    recovered = _recovered(model)
    solution = pattern_solution.solution(recovered, sensor, metric=False)
    slopes = np.empty((len(solution.estimates), len(model.names)))
    step = 1e-5
    for number, along in enumerate(np.eye(len(model.names))):
        ends = []
        for way in (step, -step):
            vector = along * way
            moved = emitter_model.apply_step(model, vector)
            ends.append([estimate.value for estimate in _solution(moved, sensor).estimates])
        slopes[:, number] = (np.array(ends[0]) - ends[1]) / (2 * step)
    rows = [".offset_m." in estimate.name for estimate in solution.estimates]
    turns = [name in ("pitch", "yaw") for name in model.names]
    slopes[np.ix_(rows, turns)] = 0
    expected = slopes @ recovered.fitted.covariance @ slopes.T
    deviation = np.sqrt(np.diagonal(expected))
    off = (solution.covariance - expected) / np.outer(deviation, deviation)
    # Components of a rotation vector differ from rotations about the axes by 4e-3.
    assert np.abs(off).max() < 0.02
    np.testing.assert_allclose(
        [estimate.sd for estimate in solution.estimates], deviation, rtol=0.02
    )


@pytest.mark.parametrize("kind", list(MODELS))
def test_names_are_sensor_paths_or_scene_scales(kind: str, sensor: Sensor) -> None:
    """Each name is a settable path of the sensor; scales of scenes have brackets."""
    solution = _solution(MODELS[kind], sensor)
    emitters = (Emitter(pattern="d415"), Emitter(pattern="d415"))
    light = dataclasses.replace(sensor.projector, emitters=emitters)
    sensor = dataclasses.replace(sensor, projector=light)
    for estimate in solution.estimates:
        name, bracket, scene = estimate.name.partition("[")
        if bracket:
            assert scene.removesuffix("]") in SCENES
        edits.with_values(sensor, [(name, estimate.value)])
    assert len({estimate.name for estimate in solution.estimates}) == len(solution.estimates)


def test_the_sensor_has_the_estimates(sensor: Sensor) -> None:
    """Estimates of the right image's alignment equal the sensor's values."""
    solution = _solution(MODELS["lattices"], sensor)
    by_name = {estimate.name: estimate for estimate in solution.estimates}
    alignment = solution.sensor.right.alignment
    assert by_name["right.alignment.offset_y_px"].value == pytest.approx(alignment.offset_y_px)
    assert by_name["right.alignment.offset_x_px"].value == pytest.approx(alignment.offset_x_px)
    assert by_name["right.alignment.roll_deg"].value == pytest.approx(alignment.roll_deg)
    assert alignment.offset_y_px == pytest.approx(0.5)
    turned = np.degrees(0.8 / sensor.fx_px)
    assert alignment.roll_deg == pytest.approx(0.02 - turned)
    product = {estimate.name: estimate for estimate in solution.derived}["focal_baseline_px_m"]
    assert product.value == pytest.approx(sensor.focal_baseline_px_m - 0.09)
    assert solution.sensor.focal_baseline_px_m == pytest.approx(product.value)
    assert product.start == pytest.approx(sensor.focal_baseline_px_m)


def test_mean_and_offsets_give_the_emitters_positions(sensor: Sensor) -> None:
    """The mean position plus the offset gives each emitter's position."""
    model = MODELS["lattices"]
    estimates = {emitter.name: emitter.value for emitter in _solution(model, sensor).estimates}
    middle = np.array([estimates[f"projector.position_m.{axis}"] for axis in "xyz"])
    from starling.sim.geometry import frames

    for number, emitter in enumerate(model.emitters):
        offset = [estimates[f"projector.emitters.{number}.offset_m.{axis}"] for axis in "xyz"]
        place = middle + frames.rotation(model.rotation_deg) @ np.array(offset)
        np.testing.assert_allclose(place, emitter.position_m, atol=1e-12)


def test_initial_offsets_need_the_same_number_of_emitters(sensor: Sensor) -> None:
    light = dataclasses.replace(sensor.projector, emitters=())
    single = dataclasses.replace(sensor, projector=light)
    for begun, offsets in (
        (sensor, [e.offset_m[0] for e in sensor.projector.emitters]),
        (single, [0, 0]),
    ):
        estimates = {e.name: e for e in _solution(MODELS["lattices"], begun).estimates}
        starts = [estimates[f"projector.emitters.{n}.offset_m.x"].start for n in range(2)]
        assert starts == offsets


def test_lattices_are_reported_by_cycles_and_angle(sensor: Sensor) -> None:
    derived = {
        estimate.name: estimate for estimate in _solution(MODELS["lattices"], sensor).derived
    }
    assert derived["emitter0.lattice.0.cycles"].value == pytest.approx(1 / 0.0123)
    assert derived["emitter0.lattice.0.angle_deg"].value == pytest.approx(49)
    assert derived["emitter1.lattice.0.angle_deg"].value == pytest.approx(60)
    assert derived["emitter1.dot_sigma_mrad"].value == pytest.approx(2)


def test_deviations_of_lattices_match_differences(sensor: Sensor) -> None:
    """Deviations of length and angle match central differences."""
    model = MODELS["lattice"]
    recovered = _recovered(model)
    derived = {
        estimate.name: estimate
        for estimate in pattern_solution.solution(recovered, sensor, metric=False).derived
    }
    indices = [model.names.index(f"emitter0.frequency.0{j}") for j in range(2)]
    block = recovered.fitted.covariance[np.ix_(indices, indices)]
    source = model.emitters[0].source
    assert isinstance(source, Lattice)

    def length_and_angle(row: np.ndarray) -> np.ndarray:
        return np.array([np.linalg.norm(row), np.degrees(np.arctan2(row[1], row[0]))])

    row = source.frequencies[0]
    slopes = np.stack(
        [
            (length_and_angle(row + 1e-4 * e) - length_and_angle(row - 1e-4 * e)) / 2e-4
            for e in np.eye(2)
        ],
        axis=1,
    )
    expected = np.sqrt(np.diagonal(slopes @ block @ slopes.T))
    names = ("emitter0.lattice.0.cycles", "emitter0.lattice.0.angle_deg")
    np.testing.assert_allclose([derived[name].sd for name in names], expected, rtol=1e-5)


def test_unidentifiable_parameters_are_reported(sensor: Sensor) -> None:
    reference = _solution(MODELS["lattices"], sensor).undetermined
    assert pattern_solution.SCALE_OPEN in reference and pattern_solution.GAUGE_OPEN in reference
    metric = _solution(MODELS["lattices"], sensor, metric=True).undetermined
    assert metric == (pattern_solution.GAUGE_OPEN,)
    image = _solution(MODELS["image"], sensor, metric=True).undetermined
    assert pattern_solution.TURN_OPEN in image
    names = [estimate.name for estimate in _solution(MODELS["image"], sensor).estimates]
    assert not any(name.startswith("projector.rotation_deg") for name in names)


@pytest.mark.parametrize("kind", ["lattices", "image"])
def test_too_few_rooms_are_reported(kind: str, sensor: Sensor) -> None:
    """A sentence names the number of rooms and the remedy, below three rooms."""
    sentences = {
        rooms: [
            line
            for line in pattern_solution.solution(
                _recovered(MODELS[kind], rooms=rooms), sensor, metric=False
            ).undetermined
            if "scatter of references between rooms" in line
        ]
        for rooms in (1, 2, 3)
    }
    assert (
        "come from 1 room and" in sentences[1][0]
        and "come from 2 rooms and" in sentences[2][0]
        and not sentences[3]
    )
    assert all("capture 3 rooms or more" in sentences[rooms][0] for rooms in (1, 2))


def test_scenes_have_their_scales(sensor: Sensor) -> None:
    solution = _solution(MODELS["image"], sensor)
    by_name = {estimate.name: estimate.value for estimate in solution.estimates}
    for name, scale in SCENES.items():
        assert by_name[f"projector.pattern_scale[{name}]"] == scale
    assert solution.sensor == pattern_sensor.with_alignment(sensor, MODELS["image"])
