"""`starling evaluate`: evaluation of methods on held-out rooms."""

from __future__ import annotations

import dataclasses
import json
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from starling.learning import registry
from starling.learning.commands import work_folder
from starling.learning.commands.evaluate_captures import FOLDS, EvaluationPlan, evaluate_captures
from starling.learning.commands.train_captures import PHYSICS, train_captures
from starling.learning.data import captured, simulated
from starling.learning.data.captured import Simulation
from starling.learning.data.example import Example, Image
from starling.learning.evaluation import pictures
from starling.learning.icp import case_study
from starling.learning.icp.study import Outcome
from starling.patterns.errors import InputError
from starling.sim.captures import png
from starling.sim.captures.capture import CaptureSet, open_set
from starling.sim.console.output import RECORD
from tests.unit.learning import capture_sets
from tests.unit.learning.step_scenes import step_scene

ROOMS = capture_sets.ROOMS
SIMPLE = EvaluationPlan(methods=("simple",))


@dataclasses.dataclass
class Spy:
    """A method that records its training and prediction calls; it predicts holes weakly."""

    fits: list[tuple[str, ...]] = dataclasses.field(default_factory=list)
    folders: list[Path] = dataclasses.field(default_factory=list)
    predictions: list[tuple[str, tuple[str, ...]]] = dataclasses.field(default_factory=list)
    fails_at: str | None = None  # Room at which the training is interrupted.
    had_physics: list[bool] = dataclasses.field(default_factory=list)  # Whether there was physics.
    name: str = "spy"

    def fit(self, examples: Sequence[Example], *, folder: Path, seed: int, track: Any) -> Learnt:
        rooms = tuple(dict.fromkeys(example.room for example in examples))
        self.fits.append(rooms)
        self.folders.append(folder)
        return Learnt(self, rooms)


@dataclasses.dataclass
class Learnt:
    """Predictor of the spy, which depends on the training rooms."""

    spy: Spy
    rooms: tuple[str, ...]

    def probability(self, example: Example) -> Image:
        if example.room == self.spy.fails_at:
            raise KeyboardInterrupt
        self.spy.predictions.append((example.room, self.rooms))
        self.spy.had_physics.append(example.physics is not None)
        rng = np.random.default_rng(len(self.rooms))
        assert example.ndp is not None
        return (0.3 * example.ndp + 0.7 * rng.random(example.ndp.shape)).astype(np.float32)


@pytest.fixture
def captures(tmp_path: Path) -> str:
    return str(capture_sets.write(tmp_path / "set"))


@pytest.fixture
def spy(monkeypatch: pytest.MonkeyPatch) -> Spy:
    """Replace every method by the spy."""
    item = Spy()
    monkeypatch.setattr(registry, "method", lambda name, *, steps=None, start=None: item)
    return item


@pytest.fixture
def no_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Skip the slow drawing of pictures."""
    monkeypatch.setattr(pictures, "curves", lambda _: b"curves")
    monkeypatch.setattr(pictures, "scenes", lambda _: b"scenes")


def figures(result: dict) -> dict:
    """Results that do not depend on place and time."""
    return {key: value for key, value in result.items() if key not in ("out", "seconds")}


def test_an_evaluation_writes_figures_pictures_and_predictions(captures, tmp_path):
    out = tmp_path / "out"
    plan = EvaluationPlan(methods=("perfect", "simple"), held=("hall", "attic"))
    result = evaluate_captures(captures, out, plan, options={"draws": 8})
    assert list(result["methods"]) == ["perfect", "simple"]
    assert list(result["rooms"]) == ["attic", "hall"]
    assert result["methods"]["perfect"]["auc"] == 0.5
    gain = result["differences"]["simple"]["perfect"]["auc"]["mean"]
    assert gain == pytest.approx(result["methods"]["simple"]["auc"] - 0.5)
    files = {str(path.relative_to(out)) for path in out.rglob("*") if path.is_file()}
    report = {
        f"{FOLDS}/{room}/{name}/{room}-view.png"
        for room in ("hall", "attic")
        for name in plan.methods
    }
    models = {f"{FOLDS}/{room}/simple/simple.npz" for room in ("hall", "attic")}
    assert files == {RECORD, "curves.png", "scenes.png", *report, *models}
    for name in ("curves.png", "scenes.png"):
        assert (out / name).read_bytes().startswith(b"\x89PNG")
    record = json.loads((out / RECORD).read_text())
    assert record["verb"] == "evaluate"
    assert record["arguments"]["plan"]["held"] == ["hall", "attic"]
    assert record["arguments"]["draws"] == 8
    assert record["figures"] == json.loads(json.dumps(figures(result)))


@pytest.mark.usefixtures("no_pictures")
def test_each_room_is_evaluated_by_training_on_the_others(captures, tmp_path, spy):
    evaluate_captures(captures, tmp_path / "out", EvaluationPlan(methods=("spy",)))
    assert [room for room, _ in spy.predictions] == list(ROOMS)
    for (room, rooms), folder in zip(spy.predictions, spy.folders, strict=True):
        assert set(rooms) == set(ROOMS) - {room}
        assert folder == tmp_path / "out" / FOLDS / room / "spy"


@pytest.mark.usefixtures("no_pictures")
def test_fewer_training_rooms_are_the_next_ones(captures, tmp_path, spy):
    plan = EvaluationPlan(methods=("spy",), learn_from=1, held=("study", "attic"))
    evaluate_captures(captures, tmp_path / "out", plan)
    assert spy.predictions == [("study", ("attic",)), ("attic", ("cellar",))]


@pytest.mark.usefixtures("no_pictures")
def test_predictions_are_stored_and_scored_in_16_bits(captures, tmp_path, spy):
    out = tmp_path / "out"
    evaluate_captures(captures, out, EvaluationPlan(methods=("spy",)))
    example = captured.examples(open_set(captures), rooms=("hall",))[0]
    report = Learnt(spy, ("a", "b", "c")).probability(example)
    remaining = png.read(out / FOLDS / "hall" / "spy" / "hall-view.png", "probability")
    assert_array_equal(remaining, np.round(report * 65535).astype(np.uint16))


@pytest.mark.usefixtures("no_pictures")
def test_models_are_evaluated_without_training(captures, tmp_path):
    train_captures("simple", captures, tmp_path / "model", rooms=("attic",))
    plan = EvaluationPlan(methods=(), models=(tmp_path / "model",))
    requests = evaluate_captures(captures, tmp_path / "models", plan)
    assert not list((tmp_path / "models").rglob("*.npz"))
    # The next room is attic.
    plan = EvaluationPlan(methods=("simple",), learn_from=1, held=("study",))
    anew = evaluate_captures(captures, tmp_path / "anew", plan)
    assert requests["rooms"]["study"] == anew["rooms"]["study"]
    assert list(requests["rooms"]) == list(ROOMS)


@pytest.mark.usefixtures("no_pictures")
@pytest.mark.parametrize("fails_at", ["cellar", "study"])
def test_an_interrupted_evaluation_continues(captures, tmp_path, spy, fails_at):
    plan, out = EvaluationPlan(methods=("spy",)), tmp_path / "out"
    whole = evaluate_captures(captures, tmp_path / "whole", plan)
    spy.fits.clear()
    spy.fails_at = fails_at
    with pytest.raises(KeyboardInterrupt):
        evaluate_captures(captures, out, plan)
    done = ROOMS.index(fails_at)
    assert len(spy.fits) == done + 1
    assert (out / work_folder.UNFINISHED).is_file() and not (out / RECORD).exists()
    spy.fails_at = None
    spy.fits.clear()
    again = evaluate_captures(captures, out, plan)
    assert len(spy.fits) == len(ROOMS) - done  # The interrupted fold and the following ones.
    assert figures(again) == figures(whole)
    assert not (out / work_folder.UNFINISHED).exists()


@pytest.mark.usefixtures("no_pictures")
def test_other_work_in_the_folder_is_refused(captures, tmp_path, spy):
    plan, out = EvaluationPlan(methods=("spy",)), tmp_path / "out"
    spy.fails_at = "hall"
    with pytest.raises(KeyboardInterrupt):
        evaluate_captures(captures, out, plan)
    spy.fails_at = None
    for method in (
        EvaluationPlan(methods=("spy",), seed=1),
        EvaluationPlan(methods=("spy",), learn_from=2),
    ):
        with pytest.raises(InputError, match="out must hold no other unfinished work"):
            evaluate_captures(captures, out, method)
    with pytest.raises(InputError, match="out must hold no other unfinished work"):
        evaluate_captures(captures, out, plan, options={"sensor": "mine"})
    evaluate_captures(captures, out, plan)
    with pytest.raises(InputError, match="out must be an empty or new folder"):
        evaluate_captures(captures, out, plan)
    spy.fits.clear()
    evaluate_captures(captures, out, plan, force=True)
    assert len(spy.fits) == len(ROOMS)


def _needs_none(held: str) -> Simulation:
    raise AssertionError(held)


@pytest.mark.usefixtures("no_pictures")
def test_each_room_has_its_sensor_and_physics_is_cached(captures, tmp_path, monkeypatch):
    powers: list[float] = []
    held: list[str] = []

    def built(scene: object, sensor: Any, **how: object):
        powers.append(sensor.left.gain)
        return step_scene(len(powers)).physics

    def simulation(room: str) -> Simulation:
        held.append(room)
        camera = capture_sets.sensor()
        left = dataclasses.replace(camera.left, gain=1.0 + ROOMS.index(room))
        return Simulation(sensor=dataclasses.replace(camera, left=left), draws=3)

    monkeypatch.setattr(simulated, "physics", built)
    plan, out = (
        EvaluationPlan(methods=("physics_recalibrated",), held=("hall", "attic")),
        tmp_path / "out",
    )
    evaluate_captures(captures, out, plan, simulations=simulation)
    assert held == ["hall", "attic"]
    assert powers == [3.0] * 4 + [1.0] * 4  # Three training rooms and the held-out one.
    assert len(list((out / PHYSICS).iterdir())) == 8


@pytest.mark.usefixtures("no_pictures")
def test_methods_without_physics_need_no_sensor(captures, tmp_path, spy):
    evaluate_captures(
        captures, tmp_path / "out", EvaluationPlan(methods=("spy",)), simulations=_needs_none
    )
    assert not any(spy.had_physics)


@pytest.mark.parametrize(
    ("plan", "line"),
    [
        (
            EvaluationPlan(methods=()),
            "methods must be at least one; got none. Give --methods or --models.",
        ),
        (
            EvaluationPlan(methods=("simple", "perfect", "simple")),
            "methods must be different; got simple, perfect, simple. Name each once.",
        ),
        (
            EvaluationPlan(methods=("hybrid",)),
            "sensor must be given for hybrid; got none. Give --sensor.",
        ),
    ],
)
def test_a_refused_evaluation_writes_no_folder(captures, tmp_path, plan, line):
    with pytest.raises(InputError) as caught:
        evaluate_captures(captures, tmp_path / "out", plan)
    assert str(caught.value) == line
    assert not (tmp_path / "out").exists()


def test_a_method_and_a_model_of_one_name_are_refused(captures, tmp_path):
    train_captures("simple", captures, tmp_path / "model")
    plan = EvaluationPlan(methods=("simple",), models=(tmp_path / "model",))
    with pytest.raises(InputError, match="methods must be different; got simple, simple"):
        evaluate_captures(captures, tmp_path / "out", plan)
    shutil.copytree(tmp_path / "model", tmp_path / "again")
    plan = EvaluationPlan(methods=(), models=(tmp_path / "model", tmp_path / "again"))
    with pytest.raises(InputError, match="methods must be different; got simple, simple"):
        evaluate_captures(captures, tmp_path / "out", plan)
    with pytest.raises(InputError, match="model must be a folder that `starling train` has"):
        evaluate_captures(
            captures, tmp_path / "out", EvaluationPlan(methods=(), models=(tmp_path,))
        )


@pytest.mark.parametrize(
    ("plan", "line"),
    [
        (
            EvaluationPlan(methods=("simple",), held=("loo",)),
            "room must be a known name; got 'loo'",
        ),
        (
            EvaluationPlan(methods=("simple",), learn_from=4),
            r"rooms to learn from must be in \[1, 3\]; got 4",
        ),
        (EvaluationPlan(methods=("oracle",)), "method must be a known name; got 'oracle'"),
        (EvaluationPlan(methods=("network",), steps=0), "steps must be"),
    ],
)
def test_wrong_rooms_methods_and_steps_are_refused(captures, tmp_path, plan, line):
    with pytest.raises(InputError, match=line):
        evaluate_captures(captures, tmp_path / "out", plan)
    assert not (tmp_path / "out").exists()


def test_unknown_rooms_are_refused_for_models(captures, tmp_path):
    train_captures("simple", captures, tmp_path / "model")
    plan = EvaluationPlan(methods=(), models=(tmp_path / "model",), held=("loo",))
    with pytest.raises(InputError, match="room must be a known name; got 'loo'"):
        evaluate_captures(captures, tmp_path / "out", plan)


def test_a_case_study_needs_trials_and_objects(captures, tmp_path):
    with pytest.raises(InputError, match=r"icp must be an integer in \[2, 1000000\]; got 1\. Give"):
        EvaluationPlan(methods=("simple",), icp=1)
    with pytest.raises(
        InputError, match="objects must have a shape that determines their pose; got none"
    ):
        evaluate_captures(captures, tmp_path / "out", EvaluationPlan(methods=("simple",), icp=2))
    assert not (tmp_path / "out").exists()


@pytest.mark.usefixtures("no_pictures")
def test_a_case_study_adds_its_figures(captures, tmp_path, monkeypatch):
    def study(opened: CaptureSet, report: dict, *, trials: int, **_: Any) -> dict[str, Outcome]:
        assert str(opened.path) == captures and trials == 7
        assert [len(views) for views in report.values()] == [len(ROOMS)] * 2
        errors = np.arange(4.0).reshape(2, 2)
        return {
            name: Outcome(objects=("s/1", "s/2"), position_m=errors + n, rotation=errors / 10)
            for n, name in enumerate(("real", *report))
        }

    monkeypatch.setattr(case_study, "check_objects", lambda _: None)
    monkeypatch.setattr(case_study, "case_study", study)
    plan = EvaluationPlan(methods=("perfect", "simple"), icp=7)
    result = evaluate_captures(captures, tmp_path / "out", plan)
    assert list(result["icp"]) == ["perfect", "simple"]
    assert result["icp"]["simple"]["position_mean_pct"] == pytest.approx(100 * 2 / 1.5)
    assert result["icp"]["simple"]["rotation_var_pct"] == 0
    without = evaluate_captures(captures, tmp_path / "plain", dataclasses.replace(plan, icp=0))
    assert without["icp"] == {}


def test_a_single_room_cannot_be_held_out(tmp_path):
    capture_sets.write(tmp_path / "set", rooms=("attic",))
    with pytest.raises(InputError, match="rooms must be at least 2; got 1"):
        evaluate_captures(str(tmp_path / "set"), tmp_path / "out", SIMPLE)


def test_the_captures_are_never_written_to(captures):
    with pytest.raises(InputError, match="out must lie outside its input"):
        evaluate_captures(captures, Path(captures) / "out", SIMPLE, force=True)
    assert not (Path(captures) / "out").exists()


@pytest.mark.usefixtures("no_pictures")
def test_initial_weights_go_to_the_method_of_the_same_name(captures, tmp_path, monkeypatch):
    built = {}

    def method(name: str, *, steps: int | None = None, start: Path | None = None) -> Spy:
        built[name] = start
        return Spy()

    train_captures("simple", captures, tmp_path / "model")
    monkeypatch.setattr(registry, "method", method)
    plan = EvaluationPlan(methods=("perfect", "simple"), start=(tmp_path / "model",))
    evaluate_captures(captures, tmp_path / "out", plan)
    assert built == {"perfect": None, "simple": tmp_path / "model"}
    plan = EvaluationPlan(methods=("perfect",), start=(tmp_path / "model",))
    with pytest.raises(InputError, match="start must be for a method that learns; got simple"):
        evaluate_captures(captures, tmp_path / "other", plan)
