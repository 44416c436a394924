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


@pytest.mark.parametrize(
    ("flag", "value", "owner"), [("--storage", "mcap", "ros2"), ("--task", "look", "lerobot")]
)
def test_flags_of_another_layout_are_refused(
    small_set: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], flag, value, owner
):
    flags = ["export", str(small_set), "--layout", "ply", "--out", str(tmp_path / "ply")]
    assert command_line.main([*flags, flag, value]) == 1
    expected = f"{flag} must be left out with --layout ply; got '{value}'. It belongs to --layout "
    assert expected + owner in capsys.readouterr().err


def test_refused_export_leaves_no_files(
    small_set: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    out = tmp_path / "bop"
    assert command_line.main(["export", str(small_set), "--layout", "bop", "--out", str(out)]) == 1
    assert "captures must show objects" in capsys.readouterr().err
    assert not out.exists()
