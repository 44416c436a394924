"""Figures as text and as JSON."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from starling.sim.console import progress, record, text


def test_rows_become_columns() -> None:
    value = {
        "seconds": 1.23456,
        "names": [],
        "scenes": {"a": {"ours": {"fill": 0.9}, "device": {"fill": None}}},
        "reasons": {"one": {"deep": {"er": {"x": 1}}}},
    }
    assert text.render(value).splitlines() == [
        "seconds  1.235",
        "names    -",
        "",
        "scenes    fill",
        "a ours     0.9",
        "a device     -",
        "",
        "reasons one  x",
        "deep er      1",
    ]


def test_other_values_are_written() -> None:
    assert text.render([{"name": "a", "x": [1, 2]}]) == "[0]\nname  a\nx     1, 2"
    assert text.render({"a": {"x": 1}, "b": {"x": 2}}) == "   x\na  1\nb  2"
    assert text.render({"a": {}}) == "a  -"
    assert text.render(3) == "3"


def test_json_holds_no_nan() -> None:
    @dataclass
    class Item:
        path: Path
        values: tuple[float, float]

    value = {1: Item(Path("x"), (np.nan, 2.0)), "n": np.float32(0.5), "a": np.arange(2)}
    assert json.loads(record.dumps(value)) == {
        "1": {"path": "x", "values": [None, 2.0]},
        "n": 0.5,
        "a": [0, 1],
    }


def test_versions_name_what_is_not_there(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(record, "_PACKAGES", ("numpy", "no-such-package"))
    found = record.versions()
    assert found["numpy"] == np.__version__
    assert found["no-such-package"] == "not installed"


@pytest.mark.parametrize(
    ("installed", "told"),
    [("opencv-python", "opencv-python"), ("", "opencv-contrib-python-headless")],
)
def test_versions_find_opencv_under_any_name(
    monkeypatch: pytest.MonkeyPatch, installed: str, told: str
) -> None:
    def version(name: str) -> str:
        if name.startswith("opencv") and name != installed:
            raise record.importlib.metadata.PackageNotFoundError(name)
        return "4.12"

    monkeypatch.setattr(record.importlib.metadata, "version", version)
    found = record.versions()
    assert found[told] == ("4.12" if installed else "not installed")
    assert found["numba"] == "4.12"
    assert sum(name.startswith("opencv") for name in found) == 1


def test_progress_speaks_only_of_long_work(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with progress.on_stderr() as track:
        assert list(track([1, 2], "count")) == [1, 2]
    assert capsys.readouterr().err == ""
    monkeypatch.setattr(progress, "_QUIET_S", -1.0)
    with progress.on_stderr() as track:
        assert list(track([1, 2], "count")) == [1, 2]
    assert capsys.readouterr().err == "count 1/2\ncount 2/2\n"
    monkeypatch.setattr(progress.sys.stderr, "isatty", lambda: True, raising=False)
    with progress.on_stderr() as track:
        assert list(track([1, 2], "count")) == [1, 2]
    assert capsys.readouterr().out == ""


def test_another_code_has_another_fingerprint(tmp_path):
    inner = tmp_path / "inner"
    inner.mkdir()
    (inner / "a.py").write_text("1")
    (tmp_path / "b.py").write_text("2")
    (inner / "notes.md").write_text("3")

    def found() -> str:
        record.code.cache_clear()
        return record.code(inner, tmp_path / "b.py")

    first = found()
    (inner / "notes.md").write_text("4")
    assert found() == first
    for path in (inner / "a.py", tmp_path / "b.py"):
        text = path.read_text()
        path.write_text("other")
        assert found() != first
        path.write_text(text)
    (inner / "a.py").rename(inner / "c.py")
    assert found() != first
