"""Figures as text and as JSON."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from starling.sim.console import progress, record, shell


def test_rows_become_columns() -> None:
    value = {
        "seconds": 1.23456,
        "names": [],
        "scenes": {"a": {"ours": {"fill": 0.9}, "device": {"fill": None}}},
        "reasons": {"one": {"deep": {"er": {"x": 1}}}},
    }
    assert shell.render(value).splitlines() == [
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
    assert shell.render([{"name": "a", "x": [1, 2]}]) == "[0]\nname  a\nx     1, 2"
    assert shell.render({"a": {"x": 1}, "b": {"x": 2}}) == "   x\na  1\nb  2"
    assert shell.render({"a": {}}) == "a  -"
    assert shell.render(3) == "3"


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


def test_versions_report_missing_packages(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(record, "_PACKAGES", ("numpy", "no-such-package"))
    result = record.versions()
    assert result["numpy"] == np.__version__
    assert result["no-such-package"] == "not installed"


@pytest.mark.parametrize(
    ("installed", "expected"),
    [("opencv-python", "opencv-python"), ("", "opencv-contrib-python-headless")],
)
def test_versions_find_opencv_under_any_name(
    monkeypatch: pytest.MonkeyPatch, installed: str, expected: str
) -> None:
    def version(name: str) -> str:
        if name.startswith("opencv") and name != installed:
            raise record.importlib.metadata.PackageNotFoundError(name)
        return "4.12"

    monkeypatch.setattr(record.importlib.metadata, "version", version)
    result = record.versions()
    assert result[expected] == ("4.12" if installed else "not installed")
    assert result["numba"] == "4.12"
    assert sum(name.startswith("opencv") for name in result) == 1


def test_progress_is_printed_for_long_work_only(
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
