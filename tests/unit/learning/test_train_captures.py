"""`starling train`: training of a method on captures."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from starling.learning.commands import work_folder
from starling.learning.commands.train_captures import PHYSICS, train_captures, trained
from starling.learning.data import captured, simulated
from starling.learning.data.captured import Simulation
from starling.learning.methods.baselines import Simple
from starling.patterns.errors import InputError
from starling.sim.captures.capture import open_set
from starling.sim.console.output import RECORD
from tests.unit.learning import capture_sets
from tests.unit.learning.step_scenes import step_scene

SIMULATION = Simulation(sensor=capture_sets.sensor(), draws=3)


@pytest.fixture
def captures(tmp_path: Path) -> str:
    return str(capture_sets.write(tmp_path / "set"))


@pytest.fixture
def simulations(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Replace the simulation by synthetic physics; returns the requested seeds."""
    seeds: list[int] = []

    def built(scene: object, sensor: object, *, draws: int, seed: int):
        seeds.append(seed)
        return step_scene(len(seeds)).physics

    monkeypatch.setattr(simulated, "physics", built)
    return seeds


def test_a_negative_seed_is_refused(captures, tmp_path):
    with pytest.raises(InputError, match=r"seed must be an integer in .*; got -1"):
        train_captures("simple", captures, tmp_path / "out", seed=-1)


def test_a_method_is_trained_and_loaded(captures, tmp_path):
    out = tmp_path / "out"
    result = train_captures("simple", captures, out, options={"sensor": None})
    assert result["method"] == "simple" and result["out"] == str(out) and result["seconds"] >= 0
    assert result["scenes"] == list(capture_sets.SCENES)
    examples = captured.examples(open_set(captures))
    assert result["ndp_rate"] == pytest.approx(captured.ndp_rate(examples))
    assert {path.name for path in out.iterdir()} == {"simple.npz", RECORD}
    record = json.loads((out / RECORD).read_text())
    assert record["verb"] == "train"
    assert record["figures"] == {key: result[key] for key in ("method", "scenes", "ndp_rate")}
    assert record["arguments"] == {
        "method": "simple", "captures": captures, "rooms": None, "steps": None, "seed": 0,
        "start": None, "simulated_with": None, "sensor": None,
    }  # fmt: skip
    name, predictor = trained(out)
    assert name == "simple"
    alone = Simple().fit(examples, folder=tmp_path / "alone", seed=0)
    assert_array_equal(predictor.probability(examples[0]), alone.probability(examples[0]))


def test_only_the_named_rooms_are_used(captures, tmp_path):
    result = train_captures("simple", captures, tmp_path / "out", rooms=("hall", "attic"))
    assert result["scenes"] == ["attic-view", "hall-view"]
    with pytest.raises(InputError, match="room must be a known name; got 'loo'"):
        train_captures("simple", captures, tmp_path / "other", rooms=("loo",))
    assert not (tmp_path / "other").exists()


def test_physics_is_simulated_if_needed_and_cached(captures, tmp_path, simulations):
    out = tmp_path / "out"
    train_captures("physics_recalibrated", captures, out, simulation=SIMULATION)
    assert len(simulations) == 4
    assert len(list((out / PHYSICS).iterdir())) == 4
    elsewhere = dataclasses.replace(SIMULATION, cache=out / PHYSICS)
    train_captures("physics_recalibrated", captures, tmp_path / "again", simulation=elsewhere)
    assert len(simulations) == 4
    assert not (tmp_path / "again" / PHYSICS).exists()
    both = [trained(tmp_path / name)[1] for name in ("out", "again")]
    assert both[0] == both[1]


def test_other_methods_run_no_simulation(captures, tmp_path, simulations):
    train_captures("simple", captures, tmp_path / "out", simulation=SIMULATION)
    assert simulations == []
    assert not (tmp_path / "out" / PHYSICS).exists()


@pytest.mark.parametrize(
    ("method", "line"),
    [
        ("physics", "sensor must be given for physics; got none. Give --sensor."),
        ("hybrid", "sensor must be given for hybrid; got none. Give --sensor."),
        ("oracle", "method must be a known name; got 'oracle'. Known: "),
    ],
)
def test_refused_training_writes_no_folder(captures, tmp_path, method, line):
    with pytest.raises(InputError) as caught:
        train_captures(method, captures, tmp_path / "out")
    assert str(caught.value).startswith(line)
    assert not (tmp_path / "out").exists()


def test_the_captures_are_never_written_to(captures, tmp_path):
    for out in (Path(captures), Path(captures) / "attic-view" / "model", tmp_path):
        with pytest.raises(InputError, match="out must lie outside its input"):
            train_captures("simple", captures, out, force=True)
    assert open_set(captures).scenes[0].truth_m() is not None


def test_interrupted_training_continues(captures, tmp_path, simulations, monkeypatch):
    out, real = tmp_path / "out", Simple.fit

    def cut_short(self, examples, *, folder, **how):
        (folder / "checkpoint").write_text("half")
        raise KeyboardInterrupt

    monkeypatch.setattr(Simple, "fit", cut_short)
    with pytest.raises(KeyboardInterrupt):
        train_captures("simple", captures, out)
    assert {path.name for path in out.iterdir()} == {"checkpoint", work_folder.UNFINISHED}
    with pytest.raises(InputError, match="model must be a folder that `starling train` has"):
        trained(out)
    with pytest.raises(InputError, match="out must hold no other unfinished work; got"):
        train_captures("simple", captures, out, seed=1)

    def goes_on(self, examples, *, folder, **how):
        assert (folder / "checkpoint").read_text() == "half"
        return real(self, examples, folder=folder, **how)

    monkeypatch.setattr(Simple, "fit", goes_on)
    train_captures("simple", captures, out)
    assert {path.name for path in out.iterdir()} == {"checkpoint", "simple.npz", RECORD}


def test_finished_training_needs_force(captures, tmp_path):
    out = tmp_path / "out"
    train_captures("simple", captures, out, rooms=("hall",))
    (out / "old").write_text("")
    with pytest.raises(InputError, match=r"out must be an empty or new folder; .* give --force\."):
        train_captures("simple", captures, out)
    assert json.loads((out / RECORD).read_text())["arguments"]["rooms"] == ["hall"]
    train_captures("simple", captures, out, force=True)
    assert {path.name for path in out.iterdir()} == {"simple.npz", RECORD}
    assert json.loads((out / RECORD).read_text())["arguments"]["rooms"] is None


@pytest.mark.parametrize(
    "record", [None, "", "[]", '{"verb": "simulate", "arguments": {"seed": 0}}', '{"arguments": 3}']
)
def test_a_folder_without_trained_model_is_refused(tmp_path, record):
    if record is not None:
        (tmp_path / RECORD).write_text(record)
    with pytest.raises(InputError) as caught:
        trained(tmp_path)
    assert str(caught.value) == (
        f"model must be a folder that `starling train` has finished; got {tmp_path}. "
        "Train it, name the right one, or one of hybrid-varied, network-varied."
    )


def test_a_record_without_its_model_is_refused(tmp_path):
    (tmp_path / RECORD).write_text('{"arguments": {"method": "simple"}}')
    with pytest.raises(InputError, match=r"^model must exist; got .*simple\.npz\. Train simple"):
        trained(tmp_path)
    (tmp_path / RECORD).write_text('{"arguments": {"method": "oracle"}}')
    with pytest.raises(InputError, match="method must be a known name; got 'oracle'"):
        trained(tmp_path)


def test_a_method_without_files_is_trained_too(captures, tmp_path):
    train_captures("perfect", captures, tmp_path / "out")
    name, predictor = trained(tmp_path / "out")
    assert name == "perfect"
    assert not np.any(predictor.probability(step_scene(0)))


def test_initial_weights_of_another_method_are_refused(captures, tmp_path):
    train_captures("simple", captures, tmp_path / "model")
    with pytest.raises(InputError) as caught:
        train_captures("network", captures, tmp_path / "out", start=tmp_path / "model")
    line = f"start must be a trained network; got {tmp_path / 'model'}, simple. Name another."
    assert str(caught.value) == line
    with pytest.raises(InputError, match="model must be a folder that `starling train` has"):
        train_captures("network", captures, tmp_path / "out", start=tmp_path / "nothing")
    with pytest.raises(InputError, match=r"start must be for one of .*; got simple"):
        train_captures("simple", captures, tmp_path / "out", start=tmp_path / "model")
    assert not (tmp_path / "out").exists()
