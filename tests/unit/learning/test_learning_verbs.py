"""`starling train`, `evaluate` and `compare --methods` on the command line."""

from __future__ import annotations

import json
import warnings
from pathlib import Path
from typing import Any

import pytest

from starling.learning.commands import train_captures
from starling.learning.data import simulated
from starling.learning.data.captured import Simulation
from starling.learning.evaluation import pictures
from starling.sim.sensor import resolve
from tests.unit.command_line import refused as _refused
from tests.unit.command_line import run as _run
from tests.unit.learning import capture_sets
from tests.unit.learning.step_scenes import step_scene


@pytest.fixture
def captures(tmp_path: Path) -> Path:
    return capture_sets.write(tmp_path / "set")


@pytest.fixture(autouse=True)
def no_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Skip the slow drawing of pictures."""
    monkeypatch.setattr(pictures, "curves", lambda _: b"curves")
    monkeypatch.setattr(pictures, "scenes", lambda _: b"scenes")


@pytest.fixture
def sensors(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, dict[str, Any]]]:
    """Replace sensor and physics by synthetic ones; returns the requested sensors."""
    requests: list[tuple[str, dict[str, Any]]] = []

    def load(name: str, **how: Any):
        requests.append((name, how))
        return capture_sets.sensor()

    monkeypatch.setattr(resolve, "load", load)
    monkeypatch.setattr(simulated, "physics", lambda *_, **__: step_scene(0).physics)
    return requests


@pytest.mark.parametrize("verb", ["train", "evaluate", "compare"])
def test_the_verbs_have_help_with_an_example(verb, capsys):
    code, out, _ = _run(verb, "--help", capsys=capsys)
    assert code == 0
    assert f"Example: starling {verb}" in out
    assert "--json" in out and "--debug" in out


@pytest.mark.parametrize(
    "arguments",
    [["train", "simple"], ["train", "simple", "set"], ["evaluate", "set"], ["compare"]],
)
def test_bad_flags_exit_2(arguments, capsys):
    assert _run(*arguments, capsys=capsys)[:2] == (2, "")


def test_train_evaluate_and_compare(captures, tmp_path, capsys):
    model, out = tmp_path / "model", tmp_path / "out"
    code, message, _ = _run("train", "simple", captures, "--out", model, "--json", capsys=capsys)
    trained = json.loads(message)
    assert (code, trained["method"]) == (0, "simple")
    assert trained["scenes"] == list(capture_sets.SCENES)
    record = json.loads((model / "starling.json").read_text())
    assert record["arguments"]["draws"] == 8 and record["arguments"]["even"] is False

    arguments = ("evaluate", captures, "--methods", "perfect", "--models", model, "--out", out)
    code, message, _ = _run(*arguments, "--json", capsys=capsys)
    assert code == 0
    assert list(json.loads(message)["methods"]) == ["perfect", "simple"]
    assert "--force" in _refused(*arguments, capsys=capsys)
    code, message, _ = _run(*arguments, "--force", "--rooms", "hall", capsys=capsys)
    assert code == 0 and "simple" in message and "hall" in message and "attic" not in message

    picture = tmp_path / "methods.png"
    arguments = ("compare", captures, "--methods", "perfect", model, "--out", picture, "--json")
    code, message, _ = _run(*arguments, capsys=capsys)
    assert code == 0
    result = json.loads(message)
    assert result["real"]["ndp_rate"] == pytest.approx(trained["ndp_rate"])
    assert result["methods"]["perfect"]["ndp_rate"] == 0
    assert result["methods"]["perfect"]["area_ks"] is None
    assert result["methods"]["simple"]["auc"] > 0.5
    drawn = picture.read_bytes()
    assert drawn.startswith(b"\x89PNG")
    assert "out must not exist" in _refused(*arguments, capsys=capsys)
    code, _, _ = _run(*arguments, "--force", "--seed", 3, capsys=capsys)
    assert code == 0 and picture.read_bytes() != drawn


def test_flags_of_train_are_passed_on(captures, tmp_path, sensors, monkeypatch, capsys):
    requests: list[dict[str, Any]] = []

    def work(method: str, captures: str, out: Path, **how: Any) -> dict[str, Any]:
        requests.append({"method": method, "captures": captures, "out": out, **how})
        return {}

    monkeypatch.setattr(train_captures, "train_captures", work)
    code, _, _ = _run(
        "train", "hybrid", captures, "--sensor", "d435", "--out", tmp_path / "out",
        "--rooms", "hall", "attic", "--steps", 5, "--draws", 3, "--even", "--seed", 2,
        "--start", tmp_path / "begun",
        "--set", "imager.gain=2", "--force", "--cache", tmp_path / "kept", capsys=capsys,
    )  # fmt: skip
    assert code == 0
    ((name, how),) = sensors
    assert (name, how["captures"], how["edits"]) == ("d435", str(captures), ("imager.gain=2",))
    (item,) = requests
    simulation = item.pop("simulation")
    assert isinstance(simulation, Simulation)
    assert (simulation.draws, simulation.even) == (3, True)
    assert simulation.cache == tmp_path / "kept"
    del item["track"]
    assert item == {
        "method": "hybrid", "captures": str(captures), "out": tmp_path / "out",
        "rooms": ("hall", "attic"), "steps": 5, "seed": 2, "force": True,
        "start": tmp_path / "begun",
        "options": {
            "sensor": "d435", "mode": "", "draws": 3, "even": True, "set": ("imager.gain=2",),
        },
    }  # fmt: skip


def test_the_held_out_room_is_inserted_into_the_name_of_the_sensor(
    captures, tmp_path, sensors, capsys
):
    code, _, err = _run(
        "evaluate", captures, "--methods", "physics", "--sensor", "fits/{room}/d435-{room}.toml",
        "--rooms", "hall", "attic", "--out", tmp_path / "out", "--draws", 2,
        "--cache", tmp_path / "kept", capsys=capsys,
    )  # fmt: skip
    assert code == 0, err
    assert list((tmp_path / "kept").iterdir()) and not (tmp_path / "out" / "physics").exists()
    names = [name for name, _ in sensors]
    assert names == ["fits/hall/d435-hall.toml", "fits/attic/d435-attic.toml"]
    assert {how["captures"] for _, how in sensors} == {str(captures)}
    record = json.loads((tmp_path / "out" / "starling.json").read_text())
    assert record["arguments"]["sensor"] == "fits/{room}/d435-{room}.toml"


def test_compare_physics_takes_a_sensor(captures, sensors, capsys):
    arguments = ("compare", captures, "--methods", "physics", "--json")
    assert "physics must be given" in _refused(*arguments, capsys=capsys)
    code, message, _ = _run(*arguments, "--sensor", "d435", capsys=capsys)
    assert code == 0 and len(sensors) == 1
    assert json.loads(message)["methods"]["physics"]["ndp_rate"] > 0


@pytest.mark.parametrize("inputs_given", ["both", "neither"])
def test_compare_takes_simulated_captures_or_methods(captures, inputs_given, capsys):
    more = (captures, "--methods", "perfect") if inputs_given == "both" else ()
    assert _refused("compare", captures, *more, capsys=capsys) == (
        f"starling: sim and methods must be one of the two; got {inputs_given}. "
        "Give simulated captures, or --methods.\n"
    )


def test_a_picture_of_methods_needs_methods(captures, tmp_path, capsys):
    picture = str(tmp_path / "x.png")
    line = _refused("compare", captures, captures, "--out", picture, capsys=capsys)
    assert line.startswith("starling: out must come with methods or judge; got ")


def test_compare_still_compares_captures(captures, tmp_path, capsys):
    again = capture_sets.write(tmp_path / "again")
    with warnings.catch_warnings():
        warnings.simplefilter("always")  # The images are within the left band.
        code, message, _ = _run("compare", captures, again, "--json", capsys=capsys)
    assert code == 0
    rate = json.loads(message)["metrics"]["ndp_rate"]
    assert rate["real"] == rate["sim"]


def test_refusals_are_one_line(captures, tmp_path, capsys):
    out = ("--out", tmp_path / "out")
    line = _refused("train", "oracle", captures, *out, capsys=capsys)
    assert "method must be a known name; got 'oracle'" in line
    line = _refused("train", "hybrid", captures, *out, capsys=capsys)
    assert line == "starling: sensor must be given for hybrid; got none. Give --sensor.\n"
    line = _refused("evaluate", captures, *out, capsys=capsys)
    assert "methods must be at least one; got none. Give --methods or --models." in line
    line = _refused("evaluate", tmp_path / "none", "--methods", "simple", *out, capsys=capsys)
    assert "captures must be a folder" in line
    line = _refused("compare", captures, "--methods", tmp_path, capsys=capsys)
    assert "model must be a folder that `starling train` has finished" in line
    line = _refused("compare", captures, "--methods", "perfect", "--out", tmp_path, capsys=capsys)
    assert "out must be a file" in line
    assert not (tmp_path / "out").exists()
