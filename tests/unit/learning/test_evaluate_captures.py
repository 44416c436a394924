"""`starling evaluate`: methods judged on rooms that they have not learnt from."""

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
from starling.learning.commands.evaluate_captures import FOLDS, Plan, evaluate_captures
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
SIMPLE = Plan(methods=("simple",))


@dataclasses.dataclass
class Spy:
    """A method that notes what it learns from and is asked; it sees holes dimly."""

    fits: list[tuple[str, ...]] = dataclasses.field(default_factory=list)
    folders: list[Path] = dataclasses.field(default_factory=list)
    asked: list[tuple[str, tuple[str, ...]]] = dataclasses.field(default_factory=list)
    breaks_at: str | None = None  # The room at which it is cut short.
    given: list[bool] = dataclasses.field(default_factory=list)  # Whether there was physics.
    name: str = "spy"

    def fit(self, examples: Sequence[Example], *, folder: Path, seed: int, track: Any) -> Learnt:
        rooms = tuple(dict.fromkeys(example.room for example in examples))
        self.fits.append(rooms)
        self.folders.append(folder)
        return Learnt(self, rooms)


@dataclasses.dataclass
class Learnt:
    """What the spy has learnt, which is different for each choice of rooms."""

    spy: Spy
    rooms: tuple[str, ...]

    def probability(self, example: Example) -> Image:
        if example.room == self.spy.breaks_at:
            raise KeyboardInterrupt
        self.spy.asked.append((example.room, self.rooms))
        self.spy.given.append(example.physics is not None)
        rng = np.random.default_rng(len(self.rooms))
        assert example.ndp is not None
        return (0.3 * example.ndp + 0.7 * rng.random(example.ndp.shape)).astype(np.float32)


@pytest.fixture
def captures(tmp_path: Path) -> str:
    return str(capture_sets.write(tmp_path / "set"))


@pytest.fixture
def spy(monkeypatch: pytest.MonkeyPatch) -> Spy:
    """Take the place of every method."""
    one = Spy()
    monkeypatch.setattr(registry, "method", lambda name, *, steps=None, start=None: one)
    return one


@pytest.fixture
def no_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Draw nothing: pictures take most of the time."""
    monkeypatch.setattr(pictures, "curves", lambda _: b"curves")
    monkeypatch.setattr(pictures, "scenes", lambda _: b"scenes")


def figures(result: dict) -> dict:
    """What does not depend on place and time."""
    return {key: value for key, value in result.items() if key not in ("out", "seconds")}


def test_an_evaluation_leaves_figures_pictures_and_what_was_told(captures, tmp_path):
    out = tmp_path / "out"
    plan = Plan(methods=("perfect", "simple"), held=("hall", "attic"))
    found = evaluate_captures(captures, out, plan, asked={"draws": 8})
    assert list(found["methods"]) == ["perfect", "simple"]
    assert list(found["rooms"]) == ["attic", "hall"]
    assert found["methods"]["perfect"]["auc"] == 0.5
    gain = found["differences"]["simple"]["perfect"]["auc"]["mean"]
    assert gain == pytest.approx(found["methods"]["simple"]["auc"] - 0.5)
    files = {str(path.relative_to(out)) for path in out.rglob("*") if path.is_file()}
    told = {
        f"{FOLDS}/{room}/{name}/{room}-view.png"
        for room in ("hall", "attic")
        for name in plan.methods
    }
    models = {f"{FOLDS}/{room}/simple/simple.npz" for room in ("hall", "attic")}
    assert files == {RECORD, "curves.png", "scenes.png", *told, *models}
    for name in ("curves.png", "scenes.png"):
        assert (out / name).read_bytes().startswith(b"\x89PNG")
    record = json.loads((out / RECORD).read_text())
    assert record["verb"] == "evaluate"
    assert record["arguments"]["plan"]["held"] == ["hall", "attic"]
    assert record["arguments"]["draws"] == 8
    assert record["figures"] == json.loads(json.dumps(figures(found)))


@pytest.mark.usefixtures("no_pictures")
def test_each_room_is_judged_by_what_was_learnt_from_the_others(captures, tmp_path, spy):
    evaluate_captures(captures, tmp_path / "out", Plan(methods=("spy",)))
    assert [room for room, _ in spy.asked] == list(ROOMS)
    for (room, rooms), folder in zip(spy.asked, spy.folders, strict=True):
        assert set(rooms) == set(ROOMS) - {room}
        assert folder == tmp_path / "out" / FOLDS / room / "spy"


@pytest.mark.usefixtures("no_pictures")
def test_fewer_rooms_are_the_next_ones(captures, tmp_path, spy):
    plan = Plan(methods=("spy",), learn_from=1, held=("study", "attic"))
    evaluate_captures(captures, tmp_path / "out", plan)
    assert spy.asked == [("study", ("attic",)), ("attic", ("cellar",))]


@pytest.mark.usefixtures("no_pictures")
def test_what_is_told_is_kept_in_16_bits_and_judged_as_it_is_kept(captures, tmp_path, spy):
    out = tmp_path / "out"
    evaluate_captures(captures, out, Plan(methods=("spy",)))
    example = captured.examples(open_set(captures), rooms=("hall",))[0]
    told = Learnt(spy, ("a", "b", "c")).probability(example)
    kept = png.read(out / FOLDS / "hall" / "spy" / "hall-view.png", "probability")
    assert_array_equal(kept, np.round(told * 65535).astype(np.uint16))


@pytest.mark.usefixtures("no_pictures")
def test_models_are_asked_as_they_are(captures, tmp_path):
    train_captures("simple", captures, tmp_path / "model", rooms=("attic",))
    plan = Plan(methods=(), models=(tmp_path / "model",))
    asked = evaluate_captures(captures, tmp_path / "models", plan)
    assert not list((tmp_path / "models").rglob("*.npz"))
    plan = Plan(methods=("simple",), learn_from=1, held=("study",))  # The next is attic.
    anew = evaluate_captures(captures, tmp_path / "anew", plan)
    assert asked["rooms"]["study"] == anew["rooms"]["study"]
    assert list(asked["rooms"]) == list(ROOMS)


@pytest.mark.usefixtures("no_pictures")
@pytest.mark.parametrize("breaks_at", ["cellar", "study"])
def test_what_was_cut_short_goes_on_without_training_again(captures, tmp_path, spy, breaks_at):
    plan, out = Plan(methods=("spy",)), tmp_path / "out"
    whole = evaluate_captures(captures, tmp_path / "whole", plan)
    spy.fits.clear()
    spy.breaks_at = breaks_at
    with pytest.raises(KeyboardInterrupt):
        evaluate_captures(captures, out, plan)
    done = ROOMS.index(breaks_at)
    assert len(spy.fits) == done + 1
    assert (out / work_folder.UNFINISHED).is_file() and not (out / RECORD).exists()
    spy.breaks_at = None
    spy.fits.clear()
    again = evaluate_captures(captures, out, plan)
    assert len(spy.fits) == len(ROOMS) - done  # The broken fold and those after it.
    assert figures(again) == figures(whole)
    assert not (out / work_folder.UNFINISHED).exists()


@pytest.mark.usefixtures("no_pictures")
def test_other_work_in_the_folder_is_refused(captures, tmp_path, spy):
    plan, out = Plan(methods=("spy",)), tmp_path / "out"
    spy.breaks_at = "hall"
    with pytest.raises(KeyboardInterrupt):
        evaluate_captures(captures, out, plan)
    spy.breaks_at = None
    for other in (Plan(methods=("spy",), seed=1), Plan(methods=("spy",), learn_from=2)):
        with pytest.raises(InputError, match="out must hold no other unfinished work"):
            evaluate_captures(captures, out, other)
    with pytest.raises(InputError, match="out must hold no other unfinished work"):
        evaluate_captures(captures, out, plan, asked={"sensor": "mine"})
    evaluate_captures(captures, out, plan)
    with pytest.raises(InputError, match="out must be an empty or new folder"):
        evaluate_captures(captures, out, plan)
    spy.fits.clear()
    evaluate_captures(captures, out, plan, force=True)
    assert len(spy.fits) == len(ROOMS)


def _needs_none(held: str) -> Simulation:
    raise AssertionError(held)


@pytest.mark.usefixtures("no_pictures")
def test_each_room_has_a_sensor_of_its_own_and_physics_is_kept(captures, tmp_path, monkeypatch):
    powers: list[float] = []
    held: list[str] = []

    def made(scene: object, sensor: Any, **how: object):
        powers.append(sensor.left.gain)
        return step_scene(len(powers)).physics

    def simulation(room: str) -> Simulation:
        held.append(room)
        camera = capture_sets.sensor()
        left = dataclasses.replace(camera.left, gain=1.0 + ROOMS.index(room))
        return Simulation(sensor=dataclasses.replace(camera, left=left), draws=3)

    monkeypatch.setattr(simulated, "physics", made)
    plan, out = Plan(methods=("physics_recalibrated",), held=("hall", "attic")), tmp_path / "out"
    evaluate_captures(captures, out, plan, simulations=simulation)
    assert held == ["hall", "attic"]
    assert powers == [3.0] * 4 + [1.0] * 4  # Three rooms learnt from and the one that is judged.
    assert len(list((out / PHYSICS).iterdir())) == 8


@pytest.mark.usefixtures("no_pictures")
def test_methods_without_physics_ask_for_no_sensor(captures, tmp_path, spy):
    evaluate_captures(captures, tmp_path / "out", Plan(methods=("spy",)), simulations=_needs_none)
    assert not any(spy.given)


@pytest.mark.parametrize(
    ("plan", "line"),
    [
        (Plan(methods=()), "methods must be at least one; got none. Give --methods or --models."),
        (
            Plan(methods=("simple", "perfect", "simple")),
            "methods must be different; got simple, perfect, simple. Name each once.",
        ),
        (Plan(methods=("hybrid",)), "sensor must be given for hybrid; got none. Give --sensor."),
    ],
)
def test_what_cannot_be_evaluated_leaves_no_folder(captures, tmp_path, plan, line):
    with pytest.raises(InputError) as caught:
        evaluate_captures(captures, tmp_path / "out", plan)
    assert str(caught.value) == line
    assert not (tmp_path / "out").exists()


def test_a_method_and_a_model_of_one_name_are_refused(captures, tmp_path):
    train_captures("simple", captures, tmp_path / "model")
    plan = Plan(methods=("simple",), models=(tmp_path / "model",))
    with pytest.raises(InputError, match="methods must be different; got simple, simple"):
        evaluate_captures(captures, tmp_path / "out", plan)
    shutil.copytree(tmp_path / "model", tmp_path / "again")
    plan = Plan(methods=(), models=(tmp_path / "model", tmp_path / "again"))
    with pytest.raises(InputError, match="methods must be different; got simple, simple"):
        evaluate_captures(captures, tmp_path / "out", plan)
    with pytest.raises(InputError, match="model must be a folder that `starling train` has"):
        evaluate_captures(captures, tmp_path / "out", Plan(methods=(), models=(tmp_path,)))


@pytest.mark.parametrize(
    ("plan", "line"),
    [
        (Plan(methods=("simple",), held=("loo",)), "room must be a known name; got 'loo'"),
        (
            Plan(methods=("simple",), learn_from=4),
            r"rooms to learn from must be in \[1, 3\]; got 4",
        ),
        (Plan(methods=("oracle",)), "method must be a known name; got 'oracle'"),
        (Plan(methods=("network",), steps=0), "steps must be"),
    ],
)
def test_wrong_rooms_methods_and_steps_are_refused(captures, tmp_path, plan, line):
    with pytest.raises(InputError, match=line):
        evaluate_captures(captures, tmp_path / "out", plan)
    assert not (tmp_path / "out").exists()


def test_models_are_asked_of_rooms_that_there_are(captures, tmp_path):
    train_captures("simple", captures, tmp_path / "model")
    plan = Plan(methods=(), models=(tmp_path / "model",), held=("loo",))
    with pytest.raises(InputError, match="room must be a known name; got 'loo'"):
        evaluate_captures(captures, tmp_path / "out", plan)


def test_a_case_study_needs_trials_and_objects(captures, tmp_path):
    with pytest.raises(InputError, match=r"icp must be an integer in \[2, 1000000\]; got 1\. Give"):
        Plan(methods=("simple",), icp=1)
    with pytest.raises(InputError, match="objects must tell their pose by their shape; got none"):
        evaluate_captures(captures, tmp_path / "out", Plan(methods=("simple",), icp=2))
    assert not (tmp_path / "out").exists()


@pytest.mark.usefixtures("no_pictures")
def test_a_case_study_is_one_figure_more(captures, tmp_path, monkeypatch):
    def study(opened: CaptureSet, told: dict, *, trials: int, **_: Any) -> dict[str, Outcome]:
        assert str(opened.path) == captures and trials == 7
        assert [len(views) for views in told.values()] == [len(ROOMS)] * 2
        errors = np.arange(4.0).reshape(2, 2)
        return {
            name: Outcome(objects=("s/1", "s/2"), position_m=errors + n, rotation=errors / 10)
            for n, name in enumerate(("real", *told))
        }

    monkeypatch.setattr(case_study, "check_objects", lambda _: None)
    monkeypatch.setattr(case_study, "case_study", study)
    plan = Plan(methods=("perfect", "simple"), icp=7)
    found = evaluate_captures(captures, tmp_path / "out", plan)
    assert list(found["icp"]) == ["perfect", "simple"]
    assert found["icp"]["simple"]["position_mean_pct"] == pytest.approx(100 * 2 / 1.5)
    assert found["icp"]["simple"]["rotation_var_pct"] == 0
    without = evaluate_captures(captures, tmp_path / "plain", dataclasses.replace(plan, icp=0))
    assert without["icp"] == {}


def test_a_single_room_cannot_be_held_out(tmp_path):
    capture_sets.write(tmp_path / "set", rooms=("attic",))
    with pytest.raises(InputError, match="rooms must be at least 2; got 1"):
        evaluate_captures(str(tmp_path / "set"), tmp_path / "out", SIMPLE)


def test_the_captures_are_never_written_to(captures):
    with pytest.raises(InputError, match="out must lie apart from what it is made from"):
        evaluate_captures(captures, Path(captures) / "out", SIMPLE, force=True)
    assert not (Path(captures) / "out").exists()


@pytest.mark.usefixtures("no_pictures")
def test_starts_go_to_the_methods_of_their_name(captures, tmp_path, monkeypatch):
    made = {}

    def method(name: str, *, steps: int | None = None, start: Path | None = None) -> Spy:
        made[name] = start
        return Spy()

    train_captures("simple", captures, tmp_path / "model")
    monkeypatch.setattr(registry, "method", method)
    plan = Plan(methods=("perfect", "simple"), start=(tmp_path / "model",))
    evaluate_captures(captures, tmp_path / "out", plan)
    assert made == {"perfect": None, "simple": tmp_path / "model"}
    plan = Plan(methods=("perfect",), start=(tmp_path / "model",))
    with pytest.raises(InputError, match="start must be for a method that learns; got simple"):
        evaluate_captures(captures, tmp_path / "other", plan)
