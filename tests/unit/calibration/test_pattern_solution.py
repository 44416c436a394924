"""A recovered pattern in a sensor's own terms: values, and how their uncertainty follows."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from starling.calibration.pattern import emitter_model, pattern_sensor, pattern_solution
from starling.calibration.pattern.cosine_image import Grid
from starling.calibration.pattern.emission import Alignment
from starling.calibration.pattern.emitter_model import Emission, Model
from starling.calibration.pattern.lattice import Lattice
from starling.calibration.pattern.pattern_fit import Fitted
from starling.calibration.pattern.recovery import Recovered
from starling.calibration.pattern.unprojected import PatternImage
from starling.calibration.solution import Solution
from starling.sim.sensor import edits, presets
from starling.sim.sensor.emitter import Emitter
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


def _model(*sources: Lattice | PatternImage) -> Model:
    return Model(
        emitters=tuple(
            Emission(position_m=np.array([0.026 + 0.004 * k, 1e-3 * k, -1e-3]), source=one)
            for k, one in enumerate(sources)
        ),
        rotation_deg=(0.4, -0.3, 0.2),
        scales=SCENES,
        alignment=Alignment(offset_y=0.4, roll=0.8, offset_x=0.3, focal_baseline=0.09),
    )


def _recovered(model: Model, seed: int = 0, rooms: int = 3) -> Recovered:
    rng = np.random.default_rng(seed)
    count = len(model.names)
    root = rng.standard_normal((count, count)) * 1e-4
    fitted = Fitted(
        model=model,
        covariance=root @ root.T,
        cost=(2.0, 1.0),
        shares=np.full(len(model.emitters), 1 / len(model.emitters)),
        rooms=rooms,
    )
    return Recovered(fitted=fitted, image=_image())


def _solution(model: Model, sensor: Sensor, *, metric: bool = False) -> Solution:
    return pattern_solution.solution(_recovered(model), sensor, metric=metric)


@pytest.fixture(scope="module")
def sensor() -> Sensor:
    """It begins with an alignment of its own."""
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
def test_the_covariance_is_mapped_by_the_values_own_differences(kind: str, sensor: Sensor) -> None:
    """Each estimate's slope by every parameter of the model: by moving the model a little.

    An emitter's offset is held in the projector's axes as they were found: its slope by their
    turn, some micrometres a milliradian, is left out, and so it is here.
    """
    model = MODELS[kind]
    recovered = _recovered(model)
    found = pattern_solution.solution(recovered, sensor, metric=False)
    slopes = np.empty((len(found.estimates), len(model.names)))
    step = 1e-5
    for number, along in enumerate(np.eye(len(model.names))):
        ends = []
        for way in (step, -step):
            vector = along * way
            moved = emitter_model.moved(model, vector)
            ends.append([one.value for one in _solution(moved, sensor).estimates])
        slopes[:, number] = (np.array(ends[0]) - ends[1]) / (2 * step)
    rows = [".offset_m." in one.name for one in found.estimates]
    turns = [name in ("pitch", "yaw") for name in model.names]
    slopes[np.ix_(rows, turns)] = 0
    expected = slopes @ recovered.fitted.covariance @ slopes.T
    deviation = np.sqrt(np.diagonal(expected))
    off = (found.covariance - expected) / np.outer(deviation, deviation)
    # Axes of a rotation vector and turns about them differ by half the vector, 4e-3.
    assert np.abs(off).max() < 0.02
    np.testing.assert_allclose([one.sd for one in found.estimates], deviation, rtol=0.02)


@pytest.mark.parametrize("kind", list(MODELS))
def test_every_name_is_a_sensor_s_or_a_scene_s(kind: str, sensor: Sensor) -> None:
    """A settable path of the sensor with its emitters; a scene's scale is one in brackets."""
    found = _solution(MODELS[kind], sensor)
    emitters = (Emitter(pattern="d415"), Emitter(pattern="d415"))
    light = dataclasses.replace(sensor.projector, emitters=emitters)
    sensor = dataclasses.replace(sensor, projector=light)
    for estimate in found.estimates:
        name, bracket, scene = estimate.name.partition("[")
        if bracket:
            assert scene.removesuffix("]") in SCENES
        edits.with_values(sensor, [(name, estimate.value)])
    assert len({one.name for one in found.estimates}) == len(found.estimates)


def test_the_sensor_has_the_estimates(sensor: Sensor) -> None:
    """What the estimates say of the right image is what the sensor has, sign for sign."""
    found = _solution(MODELS["lattices"], sensor)
    by_name = {one.name: one for one in found.estimates}
    alignment = found.sensor.right.alignment
    assert by_name["right.alignment.offset_y_px"].value == pytest.approx(alignment.offset_y_px)
    assert by_name["right.alignment.offset_x_px"].value == pytest.approx(alignment.offset_x_px)
    assert by_name["right.alignment.roll_deg"].value == pytest.approx(alignment.roll_deg)
    assert alignment.offset_y_px == pytest.approx(0.5)
    turned = np.degrees(0.8 / sensor.fx_px)
    assert alignment.roll_deg == pytest.approx(0.02 - turned)
    product = {one.name: one for one in found.derived}["focal_baseline_px_m"]
    assert product.value == pytest.approx(sensor.focal_baseline_px_m - 0.09)
    assert found.sensor.focal_baseline_px_m == pytest.approx(product.value)
    assert product.start == pytest.approx(sensor.focal_baseline_px_m)


def test_positions_are_the_emitters(sensor: Sensor) -> None:
    """Mean and offsets put together give each emitter's place again."""
    model = MODELS["lattices"]
    found = {one.name: one.value for one in _solution(model, sensor).estimates}
    middle = np.array([found[f"projector.position_m.{axis}"] for axis in "xyz"])
    from starling.sim.geometry import frames

    for number, one in enumerate(model.emitters):
        offset = [found[f"projector.emitters.{number}.offset_m.{axis}"] for axis in "xyz"]
        place = middle + frames.rotation(model.rotation_deg) @ np.array(offset)
        np.testing.assert_allclose(place, one.position_m, atol=1e-12)


def test_emitters_begin_where_the_sensor_has_as_many(sensor: Sensor) -> None:
    light = dataclasses.replace(sensor.projector, emitters=())
    one = dataclasses.replace(sensor, projector=light)
    for begun, offsets in (
        (sensor, [e.offset_m[0] for e in sensor.projector.emitters]),
        (one, [0, 0]),
    ):
        estimates = {e.name: e for e in _solution(MODELS["lattices"], begun).estimates}
        starts = [estimates[f"projector.emitters.{n}.offset_m.x"].start for n in range(2)]
        assert starts == offsets


def test_lattices_are_told_by_cycles_and_angle(sensor: Sensor) -> None:
    found = {one.name: one for one in _solution(MODELS["lattices"], sensor).derived}
    assert found["emitter0.lattice.0.cycles"].value == pytest.approx(1 / 0.0123)
    assert found["emitter0.lattice.0.angle_deg"].value == pytest.approx(49)
    assert found["emitter1.lattice.0.angle_deg"].value == pytest.approx(60)
    assert found["emitter1.dot_sigma_mrad"].value == pytest.approx(2)


def test_the_lattices_deviations_follow_their_frequencies(sensor: Sensor) -> None:
    """Length and angle of a frequency by central differences of its two components."""
    model = MODELS["lattice"]
    recovered = _recovered(model)
    found = {
        one.name: one for one in pattern_solution.solution(recovered, sensor, metric=False).derived
    }
    at = [model.names.index(f"emitter0.frequency.0{j}") for j in range(2)]
    block = recovered.fitted.covariance[np.ix_(at, at)]
    source = model.emitters[0].source
    assert isinstance(source, Lattice)

    def told(row: np.ndarray) -> np.ndarray:
        return np.array([np.linalg.norm(row), np.degrees(np.arctan2(row[1], row[0]))])

    row = source.frequencies[0]
    slopes = np.stack(
        [(told(row + 1e-4 * e) - told(row - 1e-4 * e)) / 2e-4 for e in np.eye(2)], axis=1
    )
    expected = np.sqrt(np.diagonal(slopes @ block @ slopes.T))
    names = ("emitter0.lattice.0.cycles", "emitter0.lattice.0.angle_deg")
    np.testing.assert_allclose([found[name].sd for name in names], expected, rtol=1e-5)


def test_what_is_open_is_said(sensor: Sensor) -> None:
    reference = _solution(MODELS["lattices"], sensor).undetermined
    assert pattern_solution.SCALE_OPEN in reference and pattern_solution.GAUGE_OPEN in reference
    metric = _solution(MODELS["lattices"], sensor, metric=True).undetermined
    assert metric == (pattern_solution.GAUGE_OPEN,)
    image = _solution(MODELS["image"], sensor, metric=True).undetermined
    assert pattern_solution.TURN_OPEN in image
    names = [one.name for one in _solution(MODELS["image"], sensor).estimates]
    assert not any(name.startswith("projector.rotation_deg") for name in names)


@pytest.mark.parametrize("kind", ["lattices", "image"])
def test_too_few_rooms_are_said(kind: str, sensor: Sensor) -> None:
    """With their number and what to capture; three rooms need no word."""
    said = {
        rooms: [
            line
            for line in pattern_solution.solution(
                _recovered(MODELS[kind], rooms=rooms), sensor, metric=False
            ).undetermined
            if "room to room" in line
        ]
        for rooms in (1, 2, 3)
    }
    assert "1 room says" in said[1][0] and "2 rooms say" in said[2][0] and not said[3]
    assert all("capture 3 rooms or more" in said[rooms][0] for rooms in (1, 2))


def test_scenes_have_their_scales(sensor: Sensor) -> None:
    found = _solution(MODELS["image"], sensor)
    by_name = {one.name: one.value for one in found.estimates}
    for name, scale in SCENES.items():
        assert by_name[f"projector.pattern_scale[{name}]"] == scale
    assert found.sensor == pattern_sensor.aligned(sensor, MODELS["image"])
