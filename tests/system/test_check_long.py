"""The validation with withheld effects on more cases, other matchers and real pairs.

**Rationale.** Most strong effects have to be identified, and captures without an effect must not be
reported.
"""

from __future__ import annotations

import dataclasses
import json
import shutil
from pathlib import Path
from typing import Any

import pytest

from starling.diagnosis.validation.adapters import __main__ as adapters
from starling.diagnosis.validation.adapters import own_depth
from starling.diagnosis.validation.camera import catalogue
from starling.diagnosis.validation.camera.errors import WithheldError
from starling.diagnosis.validation.camera.imperfections import EXPOSURE, TEXTURE
from starling.diagnosis.validation.protocol import limits, power, seal, shoot, tier
from starling.diagnosis.validation.protocol.case import Case
from starling.diagnosis.validation.protocol.check import Check
from starling.sim.captures import capture
from starling.sim.sensor import presets
from tests.system import small_check
from tests.system.small_check import SMALL, TRIED

pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> Any:
    with pytest.MonkeyPatch.context() as patch:
        yield small_check.diagnosed(SMALL, tmp_path_factory.mktemp("check"), patch)


def test_most_effects_are_identified_without_false_positives(done):
    check, cases = done
    scores = check.score(cases)
    assert scores["cases"] == {"null": 6, "single": 10, "pair": 2, "unknown": 6}
    assert scores["top1"] >= 0.75 and scores["in_set"] >= scores["top1"]
    assert scores["false_alarm"] <= 0.1
    assert scores["unknown_recall"] >= 0.5
    assert scores["top1"] > scores["baselines"]["random"]["top1"]
    assert scores["opened"] == 1 and check.score(cases)["opened"] == 2


def test_power_uses_the_same_scenes(done, monkeypatch):
    """Vignetting is detected far above its limit, and not far below it."""
    check, _ = done
    monkeypatch.setattr(power, "EFFECTS", ("vignetting",))
    monkeypatch.setattr(power, "LEVELS", 2)
    monkeypatch.setattr(power, "_WEAKEST", 0.02)
    strong = dataclasses.replace(check, power=True)
    cases = strong.prepare()
    strong.diagnose(cases)
    weak, strong_case = strong.score(cases)["power"]["vignetting"]
    assert weak["cases"] == strong_case["cases"] == SMALL.sets
    assert weak["named"] == 0 and strong_case["named"] == 1
    assert {path.name for path in (check.out / "power").iterdir()} >= {"hidden", "opened", "set-0"}


def test_other_matcher_is_detected_without_false_positive_in_images(done, tmp_path):
    check, _ = done
    options = {
        "sets": 1,
        "counts": {"null": 2},
        "left_out": 0,
        "matcher": "own",
        "segment": "image",
    }
    small = dataclasses.replace(SMALL, **options, own_depth_cases=1)
    run = Check(out=tmp_path, tier=small, blender=Path("none"), jobs=1)
    (tmp_path / "set-0").mkdir()
    for name in ("light", seal.INPUTS):
        (tmp_path / "set-0" / name).symlink_to(check.sets[0].folder / name)
    cases = run.prepare()
    run.diagnose(cases)
    scores = run.score(cases)
    assert scores["matcher_noticed"] == 1 and scores["false_alarm"] == 0
    segments = [set(answer.verdict.unexplained) for answer in run.sets[0].results(cases)]
    assert segments == [{"image", "depth"}, {"image"}]


def test_effects_in_real_pairs_are_compared_with_the_pairs(done, tmp_path):
    """The pairs come from a camera with another seed; only their pixels are known."""
    check, _ = done
    null = Case(number=0, kind="null", settings={}, seed=11)
    shoot.shoot(check.sets[0].source.light, null, tmp_path / "real", frames=1)
    counts = {"single": 4, "null": 3, "unknown": 1}
    pairs = tier.Tier(
        **{"number": 4, "source": "real", "matcher": "none", "sets": 1, "scenes": 4},
        **{"frames": 1, "counts": counts, "left_out": 1, "kinds": ("image",)},
    )
    options = {"captures": tmp_path / "real", "sensor": str(check.sets[0].source.sensor)}
    real = Check(out=tmp_path / "run", tier=pairs, blender=Path("none"), jobs=1, **options)
    cases = real.prepare()
    singles = [(*each.settings.items(),) for each in cases if each.kind == "single"]
    measured = limits.read(tmp_path / "run" / "set-1" / "limits.json")
    assert {*TRIED} > {name for ((name, _),) in singles}
    assert {name for name, _ in measured.departures} < {*TRIED}
    for ((name, value),) in singles:
        row = catalogue.ROWS[name]
        neutral = row.neutral_of(real.sets[0].source.camera)
        least = measured.least(row, 1 if value > neutral else -1)
        assert row.departure_from(neutral, value) >= least * (1 - 1e-9) > 0
    moved = (tmp_path / "real").rename(tmp_path / "moved")
    real = dataclasses.replace(real, captures=moved)
    assert real.prepare() == cases
    real.diagnose(cases)
    scores = real.score(cases)
    assert scores["tier"] == 4 and scores["false_alarm"] == 0
    assert scores["top1"] >= 0.5
    path = next(moved.rglob("ir_left.png"))
    path.write_bytes(path.read_bytes() + b"0")
    with pytest.raises(WithheldError, match="folder must be made of what"):
        real.prepare()


def test_detection_limits_come_from_the_diagnosis(done, capsys, tmp_path):
    """A limit is found on one side, or on both if the effect has two."""
    check, _ = done
    null = Case(number=0, kind="null", settings={}, seed=3)
    shoot.shoot(check.sets[0].source.light, null, tmp_path / "null", frames=2)
    flags = [
        "--sensor",
        str(check.sets[0].source.sensor),
        "--cache",
        str(check.sets[0].folder / "cache"),
    ]
    assert adapters.main(["detection", str(tmp_path / "null"), *flags]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["vignetting"]["below"] is None and 0 < result["vignetting"]["above"] < 3
    assert result["gamma"]["below"] < result["gamma"]["base"] < result["gamma"]["above"]
    assert adapters.main(["detection", str(tmp_path / "null"), *flags, "--effects", "gamma"]) == 0
    assert json.loads(capsys.readouterr().out) == {"gamma": result["gamma"]}
    assert adapters.main(["detection", str(tmp_path / "none"), *flags]) == 1
    assert adapters.main(["detection", str(tmp_path / "null"), *flags, "--effects", "gama"]) == 1


def test_a_remaining_gap_raises_the_detection_limits(done, capsys, tmp_path):
    """Each world has an imperfect base; a set is not compared with itself."""
    check, _ = done
    source = check.sets[0].source
    flags = ["--sensor", str(source.sensor), "--effects", "gamma"]
    world = {TEXTURE: 0.2, EXPOSURE: 0.4}
    paths = []
    for name, imperfections in (("null", {}), ("world", world)):
        null = Case(number=0, kind="null", settings={}, seed=3, imperfections=imperfections)
        shoot.shoot(source.light, null, tmp_path / name, frames=2)
        paths.append(str(tmp_path / name))
    limits_above = []
    for path in paths:
        assert adapters.main(["detection", path, *flags, "--despite-gaps"]) == 0
        limits_above.append(json.loads(capsys.readouterr().out)["gamma"]["above"])
    assert limits_above[0] < limits_above[1]
    both = ["detection", paths[0], *flags, "--despite-gaps", "--against-itself"]
    assert adapters.main(both) == 1
    assert "against-itself must be omitted with --despite-gaps" in capsys.readouterr().err


def test_batch_refuses_inconsistent_capture_sets(done, tmp_path, capsys):
    check, _ = done
    null = Case(number=0, kind="null", settings={}, seed=3)
    for number, each in enumerate(check.sets):
        shoot.shoot(each.source.light, null, tmp_path / "cases" / str(number), frames=1)
    sensor = presets.load(str(check.sets[0].source.sensor))
    own_depth.write(tmp_path / "cases", sensor)
    flags = ["--sensor", str(check.sets[0].source.sensor)]
    assert capture.open_set(tmp_path / "cases" / "0").scenes[0].frame(0).depth_m is not None
    assert adapters.main(["batch", str(tmp_path / "cases"), str(tmp_path / "out"), *flags]) == 1
    assert "same in all" in capsys.readouterr().err
    assert adapters.main(["batch", str(tmp_path), str(tmp_path / "out"), *flags]) == 1
    shutil.rmtree(tmp_path / "cases" / "1")
    shoot.shoot(check.sets[0].source.light, null, tmp_path / "cases" / "1", frames=2)
    capsys.readouterr()
    assert adapters.main(["batch", str(tmp_path / "cases"), str(tmp_path / "other"), *flags]) == 1
    assert "repeats must be equally many in all capture sets" in capsys.readouterr().err
    path_without = tmp_path / "without.json"
    for text, answer in (
        (None, "readable"),
        ("[", "JSON"),
        ("[]", "a JSON object"),
    ):
        if text is not None:
            path_without.write_text(text)
        more_flags = [*flags, "--without", str(path_without)]
        assert (
            adapters.main(["batch", str(tmp_path / "cases"), str(tmp_path / "out"), *more_flags])
            == 1
        )
        err = capsys.readouterr().err
        assert err.startswith(f"without.json must be {answer}; got ")
    more_flags = [*flags, "--cache", str(path_without)]
    assert (
        adapters.main(["batch", str(tmp_path / "cases"), str(tmp_path / "out"), *more_flags]) == 1
    )
    assert "cache must be a folder" in capsys.readouterr().err
    assert adapters.main(["own_depth", str(tmp_path), *flags]) == 1
    (tmp_path / "cases" / "0" / "clutter-60" / "0" / "ir_left.png").unlink()
    (tmp_path / "cases" / "0" / "clutter-60" / "0" / "depth.png").unlink()
    assert adapters.main(["own_depth", str(tmp_path / "cases"), *flags]) == 1
