"""The simulator alone as a method: shares of draws, plain or recalibrated."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from starling.learning.data.example import known_holes
from starling.learning.data.physics import physics_probability
from starling.learning.evaluation.metrics import judge, log_loss, pool
from starling.learning.method import Method
from starling.learning.methods import model_file
from starling.learning.methods.physics import Simulated, SimulatedPredictor
from starling.learning.methods.recalibration import Recalibration
from starling.patterns.errors import InputError
from tests.unit.learning.step_scenes import SHAPE, step_scene

SCENES = [step_scene(number) for number in range(6)]


def _loss(predictor: SimulatedPredictor, scenes: list) -> float:
    return log_loss(
        pool(judge(predictor.probability(scene), *known_holes(scene)) for scene in scenes)
    )


def test_physics_predicts_its_probability_without_training(tmp_path):
    method: Method = Simulated()
    assert method.name == "physics"
    physics = SCENES[0].physics
    assert physics is not None
    for predictor in (method.fit([], folder=tmp_path, seed=0), method.load(tmp_path)):
        report = predictor.probability(SCENES[0])
        assert (report.dtype, report.shape) == (np.float32, SHAPE)
        assert_array_equal(report, physics_probability(physics))
    assert not list(tmp_path.iterdir())


def test_an_example_without_physics_is_refused(tmp_path):
    bare = dataclasses.replace(SCENES[0], physics=None)
    line = "physics must be given for a method that uses it; got none for scene0. Simulate the"
    with pytest.raises(InputError, match=line):
        SimulatedPredictor().probability(bare)
    with pytest.raises(InputError, match=line):
        Simulated(recalibrated=True).fit([SCENES[1], bare], folder=tmp_path, seed=0)
    assert not list(tmp_path.iterdir())


def test_recalibration_improves_held_out_scenes(tmp_path):
    """Draws with half of the holes and some false ones are corrected by the line.

    The errors of held-out scenes are like those of the training scenes, unlike a real simulator's.
    """
    method: Method = Simulated(recalibrated=True)
    assert method.name == "physics_recalibrated"
    learnt = method.fit(SCENES[:4], folder=tmp_path, seed=0)
    assert isinstance(learnt, SimulatedPredictor)
    assert _loss(learnt, SCENES[4:]) < 0.8 * _loss(SimulatedPredictor(), SCENES[4:])
    report = np.concatenate([learnt.probability(s)[known_holes(s)[1]] for s in SCENES[:4]])
    ndp = np.concatenate([known_holes(s)[0][known_holes(s)[1]] for s in SCENES[:4]])
    assert report.mean() == pytest.approx(ndp.mean(), abs=1e-4)  # The effect of the offset.
    again = method.load(tmp_path)
    assert_array_equal(again.probability(SCENES[5]), learnt.probability(SCENES[5]))
    assert learnt.probability(SCENES[5]).dtype == np.float32


def test_scenes_are_weighted_equally(tmp_path):
    """For a constant prediction, half of one scene is holes and a tenth of another.

    0.3 is right, although the first counts 48 pixels and the second 3072.
    """
    physics = SCENES[0].physics
    assert physics is not None
    physics = dataclasses.replace(physics, ndp=np.full(SHAPE, 0.5, np.float32))
    few, ndp = np.zeros(SHAPE, bool), np.zeros(SHAPE, bool)
    few[:, 0], ndp[:24, 0] = True, True
    first = dataclasses.replace(SCENES[0], physics=physics, ndp=ndp, counted=few)
    tenth = np.zeros(SHAPE[0] * SHAPE[1], bool)
    tenth[::10] = True
    second = dataclasses.replace(
        first, ndp=tenth.reshape(SHAPE), counted=np.ones(SHAPE, bool), scene="second"
    )
    learnt = Simulated(recalibrated=True).fit([first, second], folder=tmp_path, seed=0)
    assert_allclose(learnt.probability(first), 0.3, atol=1e-3)


@pytest.mark.parametrize(
    ("examples", "message"),
    [
        ([], "examples must be at least one; got 0"),
        ([dataclasses.replace(SCENES[0], ndp=None)], "must have the device's depth"),
        (
            [dataclasses.replace(SCENES[0], ndp=np.zeros(SHAPE, bool))],
            "no-depth pixels must be some and not all of the counted ones; got 0 of 1536",
        ),
    ],
)
def test_uninformative_examples_are_refused(examples, message, tmp_path):
    with pytest.raises(InputError, match=message):
        Simulated(recalibrated=True).fit(examples, folder=tmp_path, seed=0)
    assert not list(tmp_path.iterdir())


def test_a_model_that_is_missing_or_damaged_is_refused(tmp_path):
    method = Simulated(recalibrated=True)
    with pytest.raises(InputError, match=r"^model must exist; got .*physics_recalibrated\.npz"):
        method.load(tmp_path)
    model_file.write(tmp_path, method.name, 1, {"slope": np.array(1.0)})
    with pytest.raises(InputError, match=r"model must be whole; got .* without offset"):
        method.load(tmp_path)


def test_the_recalibration_is_saved_and_loaded(tmp_path):
    arrays = {"slope": np.array(1.5), "offset": np.array(-0.25)}
    model_file.write(tmp_path, "physics_recalibrated", 1, arrays)
    result = Simulated(recalibrated=True).load(tmp_path)
    assert result == SimulatedPredictor(Recalibration(1.5, -0.25))
