"""The simulator alone as a method: shares of draws, as they are or put right."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from starling.learning.data.learnable import known_holes
from starling.learning.data.physics_probability import physics_probability
from starling.learning.evaluation.figures.judged import judge, pool
from starling.learning.evaluation.figures.proper_scores import log_loss
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


def test_physics_tells_its_probability_and_learns_nothing(tmp_path):
    method: Method = Simulated()
    assert method.name == "physics"
    physics = SCENES[0].physics
    assert physics is not None
    for predictor in (method.fit([], folder=tmp_path, seed=0), method.load(tmp_path)):
        told = predictor.probability(SCENES[0])
        assert (told.dtype, told.shape) == (np.float32, SHAPE)
        assert_array_equal(told, physics_probability(physics))
    assert not list(tmp_path.iterdir())


def test_an_example_without_physics_is_refused(tmp_path):
    bare = dataclasses.replace(SCENES[0], physics=None)
    line = "physics must be given to a method that builds on it; got none for scene0. Simulate the"
    with pytest.raises(InputError, match=line):
        SimulatedPredictor().probability(bare)
    with pytest.raises(InputError, match=line):
        Simulated(recalibrated=True).fit([SCENES[1], bare], folder=tmp_path, seed=0)
    assert not list(tmp_path.iterdir())


def test_recalibration_helps_on_scenes_it_was_not_fitted_on(tmp_path):
    """Draws that miss half of the holes and see some where none are: the line puts that right.

    The scenes' draws are as wrong as those learnt from, which a real simulator's need not be.
    """
    method: Method = Simulated(recalibrated=True)
    assert method.name == "physics_recalibrated"
    learnt = method.fit(SCENES[:4], folder=tmp_path, seed=0)
    assert isinstance(learnt, SimulatedPredictor)
    assert _loss(learnt, SCENES[4:]) < 0.8 * _loss(SimulatedPredictor(), SCENES[4:])
    told = np.concatenate([learnt.probability(s)[known_holes(s)[1]] for s in SCENES[:4]])
    ndp = np.concatenate([known_holes(s)[0][known_holes(s)[1]] for s in SCENES[:4]])
    assert told.mean() == pytest.approx(ndp.mean(), abs=1e-4)  # What the likelihood's offset does.
    again = method.load(tmp_path)
    assert_array_equal(again.probability(SCENES[5]), learnt.probability(SCENES[5]))
    assert learnt.probability(SCENES[5]).dtype == np.float32


def test_scenes_count_alike_however_many_pixels_count(tmp_path):
    """Told the same everywhere, half of one scene is holes and a tenth of another: 0.3 is right,
    though the first counts 48 pixels and the second 3072."""
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
        ([dataclasses.replace(SCENES[0], ndp=None)], "example must have the device's holes"),
        (
            [dataclasses.replace(SCENES[0], ndp=np.zeros(SHAPE, bool))],
            "no-depth pixels must be some and not all of the counted ones; got 0 of 1536",
        ),
    ],
)
def test_what_teaches_nothing_is_refused(examples, message, tmp_path):
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


def test_the_line_is_read_back_as_it_was(tmp_path):
    arrays = {"slope": np.array(1.5), "offset": np.array(-0.25)}
    model_file.write(tmp_path, "physics_recalibrated", 1, arrays)
    found = Simulated(recalibrated=True).load(tmp_path)
    assert found == SimulatedPredictor(Recalibration(1.5, -0.25))
