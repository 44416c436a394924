"""`starling complete`, `train completion` and `evaluate completion` on a tiny capture set."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from starling import command_line
from starling.learning.completion import methods
from starling.learning.completion.commands.train_captures import training_rooms
from starling.learning.completion.method import Completed, CompletionFrame
from starling.learning.completion.small import method
from starling.learning.completion.small.method import Small
from starling.learning.completion.small.network import SmallNetwork
from starling.learning.networks.device import initialised
from starling.patterns.errors import InputError
from starling.sim.captures import capture, png
from starling.sim.captures import info as capture_info
from tests.unit.command_line import Capsys, refused
from tests.unit.learning import capture_sets

CAUSES = "reasons"
KNOWN = """scene = "wall"
left_from_world = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0.5], [0, 0, 0, 1]]
"""


def ran(capsys: Capsys, *arguments: object) -> dict[str, Any]:
    assert command_line.main([*map(str, arguments), "--json"]) == 0
    return json.loads(capsys.readouterr().out)


@pytest.fixture
def captures(tmp_path: Path) -> Path:
    return capture_sets.write(tmp_path / "set")


@pytest.fixture
def model(tmp_path: Path) -> Path:
    """Untrained weights, as training saves them."""
    folder = tmp_path / "model"
    folder.mkdir()
    method.save(Small(initialised(SmallNetwork, 0)), folder)
    return folder


def test_every_frame_is_completed(captures: Path, tmp_path: Path, capsys: Capsys):
    label = png.encode(np.ones(capture_sets.SHAPE, np.uint8))
    for scene in capture.open_set(captures).scenes:
        (scene.path / "label.png").write_bytes(label)
        (scene.path / "0" / "reason.png").write_bytes(label)
        (scene.path / "0" / "frame.json").write_text('{"timestamp": 7, "reasons": {"valid": 1}}')
        (scene.path / "scene.toml").write_text(KNOWN)
    report = ran(capsys, "complete", captures, "--method", "poisson", "--out", tmp_path / "out")
    assert report["frames"] == 4 and report["holes_before"] > 0 and report["holes_after"] == 0
    before, after = (capture.open_set(path).scenes for path in (captures, tmp_path / "out"))
    for item, second in zip(before, after, strict=True):
        assert (item.name, item.room) == (second.name, second.room)
        inputs, result = item.frame(0), second.frame(0)
        assert inputs.depth_m is not None and result.depth_m is not None
        valid = np.isfinite(inputs.depth_m)
        np.testing.assert_array_equal(result.depth_m[valid], inputs.depth_m[valid])
        assert np.isfinite(result.depth_m).all()
        np.testing.assert_array_equal(result.ir_left, inputs.ir_left)
        np.testing.assert_array_equal(item.truth_m(), second.truth_m())
        assert result.record["completed_by"] == "poisson" and result.record["timestamp"] == 7
        assert "reasons" not in result.record and not (second.path / "0" / "reason.png").exists()
        np.testing.assert_array_equal(result.ir_right, inputs.ir_right)
        np.testing.assert_array_equal(second.label(), item.label())
        assert second.known() == item.known()
        assert not (second.path / "0" / "sigma.png").exists()  # The method estimates none.


def test_the_network_estimates_its_error(
    captures: Path, model: Path, tmp_path: Path, capsys: Capsys
):
    ran(capsys, "complete", captures, "--method", f"small={model}", "--out", tmp_path / "out")
    scene = capture.open_set(tmp_path / "out").scenes[0]
    assert (png.read(scene.path / "0" / "sigma.png", "sigma") > 0).all()


def test_a_frame_without_depth_is_reported(captures: Path, tmp_path: Path, capsys: Capsys):
    path = captures / "hall-view" / "0" / "depth.png"
    path.write_bytes(png.encode(np.zeros(capture_sets.SHAPE, np.uint16)))
    report = ran(capsys, "complete", captures, "--method", "nearest", "--out", tmp_path / "out")
    assert report["cannot"] == 1
    record = json.loads((tmp_path / "out" / "hall-view" / "0" / "frame.json").read_text())
    assert record["said"].startswith("cannot")


def test_depth_in_another_unit_is_refused_with_its_frame(captures: Path, tmp_path: Path, capsys):
    capture_file = captures / "capture.toml"
    info = dataclasses.replace(capture_info.read(capture_file), depth_unit_m=0.1)
    capture_file.write_text(capture_info.dumps(info))
    words = ("complete", captures, "--method", "poisson", "--out", tmp_path / "out")
    message = refused(*words, capsys=capsys)
    assert message.startswith("starling: scene attic-view, frame 0: depth_m must be in metres")
    assert "check depth_unit_m" in message and not (tmp_path / "out").exists()


def test_training_and_evaluation(captures: Path, tmp_path: Path, capsys: Capsys):
    model, out = tmp_path / "trained", tmp_path / "judged"
    two = ("--rooms", "attic", "cellar")
    report = ran(capsys, "train", "completion", captures, "--out", model, "--steps", 2, *two)
    assert report["frames"] == 2 and report["hole_share"] > 0
    words = ("poisson", "morphological", f"small={model}")
    figures = ran(capsys, "evaluate", "completion", captures, "--methods", *words, "--out", out)
    assert list(figures["methods"]) == ["sensor", *words]
    for word in words:
        result = figures["methods"][word]
        assert result["hole"]["missing"] == 0 < result["hole"]["pixels"]
        assert {"all", "hole", "valid", "edge", CAUSES} == set(result)
        rooms = [room["hole"]["mae_m"] for room in figures["rooms"][word].values()]
        assert result["hole"]["mae_m"] == pytest.approx(np.mean(rooms))
    assert figures["methods"]["sensor"]["hole"]["mae_m"] is None
    assert figures["methods"]["poisson"]["valid"] == figures["methods"]["sensor"]["valid"]
    gain = figures["gains"][f"small={model}"]["hole"]["mae_m"]
    means = {word: figures["methods"][word]["hole"]["mae_m"] for word in words}
    best = min(words[:2], key=lambda word: means[word])
    assert gain["best"] == best and gain["rooms"] == 4
    expected = 100 * (1 - means[f"small={model}"] / means[best])
    assert gain["gain_pct"] == pytest.approx(expected)
    assert gain["interval"][0] <= gain["gain_pct"] <= gain["interval"][1]
    assert (out / "worst.png").read_bytes().startswith(b"\x89PNG")
    assert figures["sigma"]["poisson"]["hole"]["pixels"] == 0  # The method estimates none.
    report = figures["sigma"][f"small={model}"]
    for region in ("hole", "valid"):
        pixels = figures["methods"][f"small={model}"][region]["pixels"]
        assert report[region]["pixels"] == pixels and 0 <= report[region]["within_sigma"] <= 1
        assert report[region]["interval_95"] is None  # The folder has no calibration.
    rooms = figures["sigma_rooms"][f"small={model}"]
    assert sum(room["hole"]["pixels"] for room in rooms.values()) == report["hole"]["pixels"]


def test_depth_beyond_the_16_bit_range_stays_a_hole(captures: Path, tmp_path: Path, capsys):
    """In steps of 5 um, 16 bits end at 0.33 m, nearer than part of the completed depth."""
    info = captures / "capture.toml"
    fine = dataclasses.replace(capture.open_set(captures).info, depth_unit_m=5e-6)
    info.write_text(capture_info.dumps(fine))
    for scene in capture.open_set(captures).scenes:
        code = np.linspace(20_000, 65_535, int(np.prod(capture_sets.SHAPE))).astype(np.uint16)
        code = code.reshape(capture_sets.SHAPE)
        code[:, -9:] = 0
        (scene.path / "0" / "depth.png").write_bytes(png.encode(code))
    report = ran(capsys, "complete", captures, "--method", "poisson", "--out", tmp_path / "out")
    scenes = capture.open_set(tmp_path / "out").scenes
    holes = [float(np.isnan(scene.frame(0).depth_m).mean()) for scene in scenes]
    assert report["holes_after"] == pytest.approx(np.mean(holes))


def test_gains_use_pixels_with_depth_of_all_methods(
    captures: Path, model: Path, tmp_path: Path, capsys: Capsys, monkeypatch: pytest.MonkeyPatch
):
    """Leaving out difficult pixels does not improve a method, and its picture is the worst."""
    plain = methods.create("nearest")

    class Timid:
        name = "timid"

        def fill(self, frame: CompletionFrame) -> Completed:
            report = plain.fill(frame)
            depth_m = report.depth_m.copy()
            depth_m[:, 20:] = np.nan
            return Completed(depth_m=depth_m, sigma_m=report.sigma_m)

    requests = methods.create
    monkeypatch.setattr(
        methods, "create", lambda word: Timid() if word.startswith("small") else requests(word)
    )
    words = ("nearest", f"small={model}")
    out = tmp_path / "out"
    figures = ran(capsys, "evaluate", "completion", captures, "--methods", *words, "--out", out)
    assert figures["methods"][words[1]]["hole"]["missing"] > 0
    gain = figures["gains"][words[1]]["hole"]["mae_m"]
    assert gain["gain_pct"] == 0 and gain["interval"] == [0, 0]
    record = json.loads((out / "starling.json").read_text())
    assert record["arguments"]["seed"] == 0


def test_training_rooms_are_reported(captures: Path, tmp_path: Path, capsys: Capsys):
    model = tmp_path / "trained"
    rooms = ("--rooms", "attic", "cellar")
    ran(capsys, "train", "completion", captures, "--out", model, "--steps", 1, *rooms)
    words = ("nearest", f"small={model}", "small")
    out = ("--out", tmp_path / "judged")
    figures = ran(capsys, "evaluate", "completion", captures, "--methods", *words, *out)
    assert figures["learnt_from"] == {
        "nearest": [],
        words[1]: ["attic", "cellar"],
        "small": [],
    }
    assert training_rooms(words[1], str(tmp_path), ["attic"]) == []
    assert training_rooms(f"diffusion={model}/weights", str(captures), ["attic"]) == ["attic"]
    (model / "starling.json").write_text("[]")
    assert training_rooms(words[1], str(captures), ["attic"]) == []


def test_training_on_random_holes(captures: Path, tmp_path: Path, capsys: Capsys):
    flags = ("--steps", 1, "--holes", "random")
    report = ran(capsys, "train", "completion", captures, "--out", tmp_path / "control", *flags)
    original = ran(capsys, "train", "completion", captures, "--out", tmp_path / "own", "--steps", 1)
    assert report["hole_share"] == pytest.approx(original["hole_share"], rel=0.5)


@pytest.mark.parametrize(
    ("word", "message"),
    [
        ("bilatera", "method must be a known name; got 'bilatera'. Known: bilateral"),
        ("wls=models/a", "wls must come without weights; got wls=models/a"),
        ("diffusion", "diffusion must come with weights; got diffusion. As diffusion=FOLDER."),
        ("small=", "small must come with weights"),
        ("small=nowhere", "checkpoint must exist; got nowhere/weights.pt"),
    ],
)
def test_unavailable_methods_are_refused(
    word: str, message: str, captures: Path, tmp_path: Path, capsys: Capsys
):
    out = tmp_path / "out"
    assert message in refused("complete", captures, "--method", word, "--out", out, capsys=capsys)
    assert not out.exists()


def test_missing_packages_are_named(monkeypatch: pytest.MonkeyPatch):
    def absent(name: str) -> Any:
        raise ModuleNotFoundError("gone", name="diffusers")

    monkeypatch.setattr(methods, "import_module", absent)
    with pytest.raises(InputError, match=r"marigold needs diffusers; got none\. .*\[completion\]'"):
        methods.create("marigold=somewhere")


def test_frames_without_truth_are_refused(captures: Path, tmp_path: Path, capsys: Capsys):
    out = ("--out", tmp_path / "out")
    judged = ("evaluate", "completion", captures, *out, "--methods", "nearest")
    assert "room" in refused(*judged, "--rooms", "loft", capsys=capsys)
    assert "--rooms must have a value; got none" in refused(*judged, "--rooms", capsys=capsys)
    (captures / "study-view" / "truth.png").unlink()
    for words in (judged, ("train", "completion", captures, *out)):
        assert "scene study-view must have truth.png; got none" in refused(*words, capsys=capsys)


def test_evaluation_needs_a_method(captures: Path, tmp_path: Path):
    from starling.learning.completion.commands.judge_captures import judge_captures

    with pytest.raises(InputError, match="methods must be at least one; got none"):
        judge_captures(str(captures), (), tmp_path / "out")
    with pytest.raises(InputError, match=r"seed must be an integer in .*; got -3"):
        judge_captures(str(captures), ("nearest",), tmp_path / "out", seed=-3)
