"""`starling compare --judge` on small capture sets."""

from __future__ import annotations

import json
import sys
import warnings
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from starling.learning.commands import judge_captures
from starling.learning.evaluation.evaluate import HolePrediction
from starling.learning.judge import judge as judging
from starling.learning.judge import samples
from starling.learning.judge.training import JudgeSettings
from starling.patterns.errors import InputError
from starling.sim.captures import capture
from tests.unit.command_line import refused as _refused
from tests.unit.command_line import run as _run
from tests.unit.conftest import INFO
from tests.unit.learning import seen

SHAPE = (112, 336)  # Two windows right of the left band.
ROOMS = ("attic", "barn", "cellar", "den")


pytestmark = pytest.mark.filterwarnings("ignore:judge. 8 windows")


@pytest.fixture(autouse=True)
def short_training(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(judging, "JudgeSettings", partial(JudgeSettings, steps=12, pairs=1))


def _write(path: Path, *, holes: float, seed: int, shape: tuple[int, int] = SHAPE) -> Path:
    rng = np.random.default_rng(seed)
    path.mkdir()
    info = INFO.replace("width = 160", f"width = {shape[1]}")
    (path / "capture.toml").write_text(info.replace("height = 48", f"height = {shape[0]}"))
    for room in ROOMS:
        frame = path / room / "0"
        frame.mkdir(parents=True)
        depth = rng.integers(995, 1005, shape).astype(np.uint16)
        depth[rng.random(shape) < holes] = 0
        cv2.imwrite(str(frame / "depth.png"), depth)
        for side in ("left", "right"):
            image = rng.integers(20, 90, shape).astype(np.uint8)
            cv2.imwrite(str(frame / f"ir_{side}.png"), image)
    return path


@pytest.fixture
def real(tmp_path: Path) -> Path:
    return _write(tmp_path / "real", holes=0.01, seed=1)


@pytest.fixture
def sim(tmp_path: Path) -> Path:
    return _write(tmp_path / "sim", holes=0.1, seed=2)


def test_the_judge_reports_each_kind_and_draws_it(real, sim, tmp_path, capsys):
    out = tmp_path / "out"
    arguments = ("compare", real, sim, "--judge", "--out", out, "--json")
    code, message, _ = _run(*arguments, capsys=capsys)
    assert code == 0
    result = json.loads(message)
    assert result["metrics"]["ndp_rate"]["gap"] > 0.05
    assert list(result["judge"]) == ["depth", "holes", "infrared"]
    for figures in result["judge"].values():
        keys = {"auc", "interval", "p_value", "rooms", "windows", "single", "seconds"}
        assert set(figures) == keys
        assert figures["single"] == {"mean": figures["auc"], "deviation": None}
        assert set(figures["rooms"]) == set(ROOMS) and figures["windows"] == 2 * len(ROOMS)
    assert result["judge"]["holes"]["auc"] > 0.9
    for kind in result["judge"]:
        names = [f"{kind}-windows.png", *(f"{kind}/{room}.png" for room in ROOMS)]
        assert all((out / name).read_bytes().startswith(b"\x89PNG") for name in names)
    record = json.loads((out / "starling.json").read_text())
    assert record["arguments"]["seed"] == 0
    assert record["figures"]["judge"]["holes"]["auc"] == result["judge"]["holes"]["auc"]
    assert "--force" in _refused(*arguments, capsys=capsys)


def test_one_kind_by_two_judges_without_pictures(real, sim, capsys):
    arguments = ("compare", real, sim, "--judge", "--judge-kinds", "holes", "--judges", "2")
    code, message, _ = _run(*arguments, "--json", capsys=capsys)
    result = json.loads(message)
    assert code == 0 and list(result["judge"]) == ["holes"] and "out" not in result
    sets = capture.open_set(real), capture.open_set(sim)
    first, second = (
        judge_captures.judge_captures(*sets, ["holes"], seed=seed)["holes"]["auc"]
        for seed in (0, 1)
    )
    single = result["judge"]["holes"]["single"]
    assert single["mean"] == pytest.approx((first + second) / 2)
    assert single["deviation"] == pytest.approx(abs(first - second) / 2**0.5)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--methods", "physics", "--judge"), "judge must come with simulated captures"),
        (("sim", "--judge", "--judges", "0"), "judges must be an integer in [1, 100]; got 0"),
        (("sim", "--judges", "2"), "judges must come with judge; got 2"),
        (("sim", "--out", "out"), "out must come with methods or judge"),
        (("sim", "--judge", "--out", "real"), "out must lie outside its input"),
    ],
)
def test_flags_that_do_not_fit_are_refused(arguments, words, real, sim, tmp_path, capsys):
    paths = {"sim": sim, "out": tmp_path / "out", "real": real}
    words_given = [paths.get(word, word) for word in arguments]
    assert words in _refused("compare", real, *words_given, capsys=capsys)


@pytest.mark.parametrize(("few", "warns"), [(9, True), (8, False)])
def test_few_windows_give_a_warning(few, warns, real, sim, monkeypatch):
    monkeypatch.setattr(judge_captures, "_FEW_WINDOWS", few)
    sets = capture.open_set(real), capture.open_set(sim)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        judge_captures.judge_captures(*sets, ["holes"])
    text = "judge: 8 windows of each side are too few for a reliable AUC"
    assert any(text in str(each.message) for each in caught) is warns


def test_a_missing_package_is_named(real, sim, monkeypatch, capsys):
    from starling.learning import commands

    monkeypatch.delattr(commands, "judge_captures", raising=False)
    monkeypatch.setitem(sys.modules, "starling.learning.commands.judge_captures", None)
    refusal = _refused("compare", real, sim, "--judge", capsys=capsys)
    assert "judge needs starling.learning.commands.judge_captures" in refusal
    assert "[learning]" in refusal


def test_images_of_two_sizes_are_refused(real, tmp_path):
    higher = _write(tmp_path / "higher", holes=0.1, seed=2, shape=(128, 336))
    first, second = (capture.open_set(path).scenes[0] for path in (real, higher))
    cells = torch.zeros(1)
    with pytest.raises(InputError, match="must have one image size"):
        samples.pair(first, cells, second, cells)


def test_images_smaller_than_a_window_are_refused(tmp_path):
    small = _write(tmp_path / "small", holes=0.1, seed=2, shape=(90, 336))
    with pytest.raises(InputError, match="at least 224 x 96 px to be judged; got 336 x 90"):
        samples.read("holes", capture.open_set(small).scenes[0])


def test_areas_without_reference_are_hidden_on_both_sides(real, sim):
    truth = np.full(SHAPE, 1000, np.uint16)
    truth[:, 224:] = 0
    truth[:, 180] = 0  # A thin gap still counts.
    for room in ROOMS:
        cv2.imwrite(str(real / room / "truth.png"), truth)
    pairs = samples.pairs("holes", capture.open_set(real), capture.open_set(sim))
    shown = pairs[0].shown
    assert (shown[..., :6] == 1).all() and (shown[..., 6:] == 0).all()
    assert (pairs[0].cells[..., 6:] == 0).all()


def test_the_flip_of_a_scene_is_its_image_upside_down(real):
    scene = capture.open_set(real).scenes[0]
    upright, flipped = samples.read("holes", scene)
    assert torch.equal(upright[0], flipped[0].flip(-2))  # Share of holes.
    assert not torch.equal(upright, flipped)


@pytest.mark.slow
def test_evaluate_judges_the_holes_of_each_method(real, tmp_path, capsys):
    """Holes of one pixel on a plane: no method without them is taken for the device."""
    for room in ROOMS:
        cv2.imwrite(str(real / room / "truth.png"), np.full(SHAPE, 1000, np.uint16))
    out = tmp_path / "out"
    arguments = ("evaluate", real, "--methods", "perfect", "simple", "--out", out, "--json")
    code, message, _ = _run(*arguments, "--judge", "--judges", "2", capsys=capsys)
    assert code == 0
    methods = json.loads(message)["methods"]
    for figures in methods.values():
        assert list(figures["judge"]) == ["holes"]
        assert figures["judge"]["holes"]["windows"] == 2 * len(ROOMS)
        assert figures["judge"]["holes"]["single"]["deviation"] is not None
    assert methods["perfect"]["judge"]["holes"]["auc"] == 1
    assert (
        "judge"
        not in json.loads(_run(*arguments, "--force", capsys=capsys)[1])["methods"]["simple"]
    )


def test_an_unknown_reference_is_no_drawn_hole():
    """Only the drawn holes count, also where no surface is known."""
    disparity_px = seen.flat()
    disparity_px[:, :20] = np.nan
    ndp = np.zeros(disparity_px.shape, bool)
    ndp[5:9, 60:70] = True
    prediction = HolePrediction(
        example=seen.example(disparity_px), probability=ndp.astype(np.float32)
    )
    frame = judge_captures._drawn("network", prediction, 0)
    assert frame.depth_m is not None
    np.testing.assert_array_equal(np.isnan(frame.depth_m), ndp)
