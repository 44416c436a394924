"""The validation with withheld effects from light to scores, with few scenes and tiny images.

**Rationale.** The tests check that the parts work together and that the truth stays sealed. On the
whole table, `starling withheld` measures how often the right effect is identified.
"""

from __future__ import annotations

import dataclasses
import json
import shutil
from collections import Counter
from pathlib import Path
from typing import Any

import pytest

from starling.diagnosis.validation import __main__
from starling.diagnosis.validation.adapters import __main__ as adapters
from starling.diagnosis.validation.adapters import own_depth
from starling.diagnosis.validation.camera.errors import WithheldError
from starling.diagnosis.validation.protocol import files, programs, seal, shoot
from starling.diagnosis.validation.protocol.case import Case
from starling.diagnosis.validation.protocol.check import Check
from tests.system import small_check
from tests.system.small_check import TINY

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> Any:
    with pytest.MonkeyPatch.context() as patch:
        yield small_check.diagnosed(TINY, tmp_path_factory.mktemp("check"), patch)


def test_every_case_is_scored(done):
    check, cases = done
    scores = check.score(cases)
    assert scores["cases"] == {"null": 2, "single": 2, "pair": 1, "unknown": 2}
    assert scores["top1"] >= 0.5 and scores["in_set"] >= scores["top1"]
    assert scores["false_alarm"] == 0
    assert scores["opened"] == 1 and check.score(cases)["opened"] == 2


def test_diagnosis_sees_only_captures(done):
    check, _ = done
    for each in check.sets:
        assert not (each.folder / "cases").exists()  # Removed with the last verdict.
        assert not (each.folder / ".without").exists()
    shown: dict[Path, set[bytes]] = {}
    for path, content in small_check.SHOWN:
        shown.setdefault(path, set()).add(content)
    assert {"capture.toml", "scene.toml"} <= {path.name for path in shown}
    assert all(len(contents) == 1 for contents in shown.values())  # The same content in all cases.
    assert {path.name for path in check.hidden.iterdir()} == {seal.TRUTH}


def test_stopped_run_continues(done, monkeypatch):
    check, cases = done
    lost = check.sets[0].folder / "whole" / f"{cases[0].number:03d}.json"
    before = json.loads(lost.read_text())
    lost.unlink()
    calls = []
    monkeypatch.setattr(programs, "diagnose", lambda *a, **k: calls.append(a))
    with pytest.raises(WithheldError, match="verdict"):
        check.diagnose(cases)
        check.score(cases)
    assert len(calls) == 1
    monkeypatch.undo()
    check.diagnose(cases)
    after = json.loads(lost.read_text())
    assert {**after, "seconds": 0} == {**before, "seconds": 0}


def test_first_sets_can_run_alone(done, tmp_path):
    """Cases are drawn for all sets, but verdicts of later sets are neither needed nor scored."""
    check, cases = done
    first = dataclasses.replace(check, set_limit=1)
    assert first.prepare() == tuple(cases)
    later = next(case for case in cases if case.number % 2)
    verdict = check.sets[1].folder / "whole" / f"{later.number:03d}.json"
    verdict.rename(tmp_path / "kept")
    try:
        first.diagnose(cases)
        scores = first.score(cases)
        with pytest.raises(WithheldError, match="verdict"):
            check.score(cases)
    finally:
        (tmp_path / "kept").rename(verdict)
    assert scores["sets"] == {"asked": 1, "all": 2}
    counts = Counter(case.kind for case in cases if case.number % 2 == 0)
    assert {kind: scores["cases"][kind] for kind in ("null", "single", "pair")} == {
        kind: counts[kind] for kind in ("null", "single", "pair")
    }


def test_changed_truth_is_refused(done):
    check, _ = done
    truth = check.hidden / seal.TRUTH
    text = truth.read_text()
    truth.write_text(text.replace("null", "null ", 1))
    try:
        with pytest.raises(WithheldError, match="sealed"):
            check.prepare()
    finally:
        truth.write_text(text)


def test_folder_belongs_to_one_run_with_fixed_options(done, monkeypatch):
    check, cases = done
    with pytest.raises(WithheldError, match=r"asked\.json must be what .*\"cases\": 3"):
        dataclasses.replace(check, singles=3).prepare()
    lost = check.sets[0].folder / "whole" / f"{cases[0].number:03d}.json"
    before = lost.read_text()
    lost.unlink()
    with monkeypatch.context() as patch:
        patch.setattr(seal, "code_digest", lambda: "another")
        with pytest.raises(WithheldError, match="code must be the sealed code"):
            check.diagnose(cases)
    with (
        files.exclusive(check.sets[0].folder),
        pytest.raises(WithheldError, match="folder must be used by one run at a time"),
    ):
        check.diagnose(cases)
    sealed = (check.folder / seal.SEAL).read_bytes()
    (check.folder / seal.SEAL).unlink()
    with pytest.raises(WithheldError, match="captures and verdicts must come after the seal"):
        check.prepare()
    (check.folder / seal.SEAL).write_bytes(sealed)
    lost.write_text(before)


def test_without_infrared_only_depth_is_diagnosed(done, tmp_path):
    check, _ = done
    few = dataclasses.replace(TINY, sets=1, counts={"null": 1}, left_out=0)
    bare = Check(out=tmp_path, tier=few, blender=Path("none"), jobs=1, infrared=False)
    (tmp_path / "set-0").mkdir()
    for name in ("light", seal.INPUTS):
        (tmp_path / "set-0" / name).symlink_to(check.sets[0].folder / name)
    cases = bare.prepare()
    bare.diagnose(cases)
    assert bare.score(cases)["false_alarm"] == 0
    (answer,) = bare.sets[0].results(cases)
    assert set(answer.verdict.unexplained) == {"whole"}
    assert bare.folder == tmp_path / "depth alone" and (bare.folder / seal.SEAL).exists()


def test_the_program_prints_scores(done, monkeypatch, capsys):
    check, _ = done
    monkeypatch.setitem(__main__.TIERS, 1, TINY)
    assert __main__.main([str(check.out), "--jobs", "1", "--json"]) == 0
    scores = json.loads(capsys.readouterr().out)
    assert scores == {**json.loads((check.out / "scores.json").read_text())}
    assert __main__.main([str(check.out), "--jobs", "1"]) == 0
    assert "top1" in capsys.readouterr().out
    assert __main__.main([str(check.out), "--cases", "0"]) == 1
    assert "cases must be >= 1" in capsys.readouterr().err


def test_failing_program_is_reported_with_its_message(tmp_path, monkeypatch):
    monkeypatch.setattr(programs, "_run", small_check.RUN)
    with pytest.raises(WithheldError, match=r"adapters\.batch must succeed.*cases must hold"):
        programs.diagnose(tmp_path, tmp_path / "out", tmp_path / "s.toml", tmp_path / "cache")


def test_inconsistent_options_are_refused(tmp_path):
    with pytest.raises(WithheldError, match="tier 1 must have infrared; got none"):
        tier = dataclasses.replace(TINY, matcher="own", segment="image")
        Check(out=tmp_path, tier=tier, blender=Path("none"), infrared=False)


def test_programs_refuse_unusable_capture_sets(done, tmp_path, capsys):
    check, _ = done
    null = Case(number=0, kind="null", settings={}, seed=3)
    light, name = tmp_path / "light", "clutter-60"
    shutil.copytree(check.sets[0].source.light / name, light / name)
    for path in check.sets[0].source.light.glob("*.*"):
        shutil.copy(path, light)
    shoot.shoot(light, null, tmp_path / "cases" / "0", frames=1)
    flags = ["--sensor", str(check.sets[0].source.sensor)]

    def refused(program: str, cases: Path, *words: str) -> str:
        outputs = [str(tmp_path / "out")] * (program == "batch")
        assert adapters.main([program, str(cases), *outputs, *flags, *words]) == 1
        return capsys.readouterr().err

    assert "cases must hold capture sets" in refused("batch", tmp_path / "none")
    path_without = tmp_path / "without.json"
    for text, answer in ((None, "readable"), ("[", "JSON"), ("[]", "a JSON object")):
        if text is not None:
            path_without.write_text(text)
        message = refused("batch", tmp_path / "cases", "--without", str(path_without))
        assert message.startswith(f"without.json must be {answer}; got ")
    assert "cases must hold capture sets" in refused("own_depth", tmp_path / "none")
    (tmp_path / "cases" / "0" / name / "0" / own_depth.DEPTH).unlink(missing_ok=True)
    (tmp_path / "cases" / "0" / name / "0" / "ir_right.png").unlink()
    assert "must be an infrared pair" in refused("own_depth", tmp_path / "cases")


def test_two_sets_run_in_two_processes(done):
    check, cases = done
    assert dataclasses.replace(check, jobs=2).prepare() == tuple(cases)
