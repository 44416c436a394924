"""`starling evaluate` on another capture set; sizes and progress before and during simulation."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import pytest

from starling.learning.commands import evaluate_captures as evaluate_module
from starling.learning.commands.evaluate_captures import EvaluationPlan, evaluate_captures
from starling.learning.data import simulated
from starling.learning.data.captured import Simulation
from starling.learning.evaluation import pictures
from starling.patterns.errors import InputError
from tests.unit.learning import capture_sets
from tests.unit.learning.step_scenes import step_scene

ROOMS = capture_sets.ROOMS


@pytest.fixture
def captures(tmp_path: Path) -> str:
    return str(capture_sets.write(tmp_path / "set"))


@pytest.fixture
def no_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Skip the slow drawing of pictures."""
    monkeypatch.setattr(pictures, "curves", lambda _: b"curves")
    monkeypatch.setattr(pictures, "scenes", lambda _: b"scenes")


@pytest.mark.usefixtures("no_pictures")
def test_rooms_of_another_set_are_held_out(captures, tmp_path):
    """All of them learn from the whole first set, once."""
    others = str(capture_sets.write(tmp_path / "others"))
    out = tmp_path / "out"
    plan = EvaluationPlan(methods=("perfect", "simple"), heldout=others)
    result = evaluate_captures(captures, out, plan)
    assert sorted(result["rooms"]) == sorted(ROOMS)
    assert len(list(out.rglob("simple.npz"))) == 1


@pytest.mark.usefixtures("no_pictures")
def test_scenes_of_another_set_have_their_own_sensor(captures, tmp_path, monkeypatch):
    gains: list[float] = []

    def built(scene: object, sensor: Any, **how: object):
        gains.append(sensor.left.gain)
        return step_scene(len(gains)).physics

    def simulation(gain: float) -> Simulation:
        camera = capture_sets.sensor()
        left = dataclasses.replace(camera.left, gain=gain)
        return Simulation(sensor=dataclasses.replace(camera, left=left), draws=3)

    monkeypatch.setattr(simulated, "physics", built)
    plan = EvaluationPlan(
        methods=("physics",),
        held=("hall",),
        heldout=str(capture_sets.write(tmp_path / "others")),
        learn_from=2,
    )
    evaluate_captures(
        captures,
        tmp_path / "out",
        plan,
        simulations=lambda _: simulation(2.0),
        heldout_simulations=lambda _: simulation(3.0),
    )
    assert gains == [2.0] * 2 + [3.0]


def test_the_captures_of_the_training_are_no_other_set(captures, tmp_path):
    plan = EvaluationPlan(methods=("simple",), heldout=captures)
    with pytest.raises(InputError, match=r"^heldout must be other captures; got .*give --rooms\."):
        evaluate_captures(captures, tmp_path / "out", plan)


def test_models_of_another_size_are_refused_before_anything_is_simulated(
    captures, tmp_path, monkeypatch
):
    class Fixed:
        only_shape = (40, 60)

    monkeypatch.setattr(evaluate_module, "trained", lambda folder: ("pix2pix", Fixed()))
    plan = EvaluationPlan(methods=(), models=(tmp_path / "model",))
    with pytest.raises(
        InputError, match=r"^model must be for the size of the scenes, .* got 60x40"
    ):
        evaluate_captures(captures, tmp_path / "out", plan)


@pytest.mark.usefixtures("no_pictures")
def test_simulation_shows_progress(captures, tmp_path, monkeypatch):
    labels: list[str] = []

    def track(items: Any, label: str) -> Any:
        labels.append(label)
        return items

    def built(scene: object, sensor: Any, **how: object):
        return step_scene(len(labels)).physics

    monkeypatch.setattr(simulated, "physics", built)
    plan = EvaluationPlan(methods=("physics",), held=("hall",))
    evaluate_captures(
        captures,
        tmp_path / "out",
        plan,
        simulations=lambda _: Simulation(sensor=capture_sets.sensor(), draws=3),
        track=track,
    )
    assert labels.count("scenes") >= 2
