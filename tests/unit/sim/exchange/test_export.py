"""`starling export` writes a complete folder or none."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from starling import command_line
from starling.sim.captures.exchange import tum


def test_a_set_is_exported(small_set: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    out = tmp_path / "tum"
    flags = ["export", str(small_set), "--layout", "tum", "--out", str(out), "--json"]
    assert command_line.main(flags) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["frames"] == len(tum.read(out).moments) and report["layout"] == "tum"
    assert json.loads((out / "starling.json").read_text())["verb"] == "export"
    assert command_line.main(flags) == 1  # Nothing is overwritten unasked.
    assert command_line.main([*flags, "--force"]) == 0
    capsys.readouterr()


def test_refused_export_leaves_no_files(
    small_set: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    out = tmp_path / "bop"
    assert command_line.main(["export", str(small_set), "--layout", "bop", "--out", str(out)]) == 1
    assert "captures must show objects" in capsys.readouterr().err
    assert not out.exists()
