"""The benchmark that makes the check's detection limits: what it reuses, and what it says of it."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from starling.diagnosis.validation.camera.errors import WithheldError
from tests import script

PATH = Path(__file__).parents[3] / "benchmarks" / "diagnosis" / "detection_limits.py"
FOUND = {"veil": {"base": 0.0, "below": None, "above": 0.1}}


@pytest.fixture
def benchmark() -> Any:
    return script.load("benchmarks/diagnosis/detection_limits.py")


def run(benchmark: Any, monkeypatch: pytest.MonkeyPatch, *arguments: str) -> None:
    monkeypatch.setattr(sys, "argv", ["detection_limits.py", "--work", "none", *arguments])
    benchmark.main()


def test_limits_of_some_effects_replace_no_file(
    benchmark: Any,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
):
    monkeypatch.setattr(benchmark, "measure_set", lambda *_: FOUND)
    out = tmp_path / "detection.json"
    run(benchmark, monkeypatch, "--out", str(out), "--effects", "veil")
    told = json.loads(out.read_text())
    assert told["veil"] == FOUND["veil"] and {*told} == {"made of", "veil"}
    assert len(told["made of"]["scenes"]) == 2 and told["made of"]["commit"]
    before = out.read_bytes()
    with pytest.raises(SystemExit):
        run(benchmark, monkeypatch, "--out", str(out), "--effects", "gamma")
    assert "out must be a new file if effects are named" in capsys.readouterr().err
    assert out.read_bytes() == before
    with pytest.raises(SystemExit):
        run(benchmark, monkeypatch, "--effects", "veil")
    assert f"got {benchmark.limits.FILE}. Give --out" in capsys.readouterr().err


def test_a_commit_is_marked_where_there_are_changes(
    benchmark: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """Wherever it is run from."""
    monkeypatch.setattr(benchmark, "ROOT", tmp_path)
    by = ("-c", "user.name=a", "-c", "user.email=a@b.c", "-c", "commit.gpgsign=false")
    for words in (("init", "-q"), (*by, "commit", "-q", "--allow-empty", "-m", "first")):
        subprocess.run(["git", *words], cwd=tmp_path, check=True)
    clean = benchmark.describe_commit()
    assert clean.isalnum()
    (tmp_path / "new.py").touch()
    assert benchmark.describe_commit() == f"{clean} with changes"


def test_limits_are_of_one_code(benchmark: Any, monkeypatch: pytest.MonkeyPatch):
    codes = iter(["one", "other"])
    monkeypatch.setattr(benchmark, "measure_set", lambda *_: FOUND)
    monkeypatch.setattr(benchmark.seal, "code_digest", lambda: next(codes))
    with pytest.raises(WithheldError, match="code must not change during the run; got other code"):
        benchmark.measure(Path("none"), [])


def test_another_code_makes_light_and_captures_anew(
    benchmark: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """What was simulated is kept in one place, as it is named by all that it follows from."""
    made: list[Path] = []
    asked: list[tuple[Path, Path]] = []

    def write(light: Path, *_: Any) -> None:
        light.mkdir(parents=True)
        made.append(light)

    def limits(captures: Path, *_: Any, cache: Path, **__: Any) -> dict[str, Any]:
        asked.append((captures, cache))
        return FOUND

    monkeypatch.setattr(benchmark.cameras, "builtin_camera", lambda *_: None)
    monkeypatch.setattr(benchmark.light_sets, "write", write)
    monkeypatch.setattr(
        benchmark.shoot, "shoot", lambda _, __, out, frames: out.mkdir(parents=True)
    )
    monkeypatch.setattr(benchmark.programs, "run", lambda *_, **__: None)
    monkeypatch.setattr(benchmark.presets, "load", lambda _: None)
    monkeypatch.setattr(benchmark.detection, "limits", limits)
    for code in ("one", "one", "other"):
        benchmark.measure_set(tmp_path, [], code, 9300)
    assert len(made) == 2
    assert asked[0] == asked[1] and asked[2][0] != asked[0][0]
    assert len({cache for _, cache in asked}) == 1
