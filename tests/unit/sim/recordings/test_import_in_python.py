"""`starling.import_recording` is the verb `import` in Python."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import starling
from starling import command_line
from tests.unit.sim.recordings import scene


def test_python_imports_as_the_verb_does(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    folder, first, second = (tmp_path / name for name in ("shots", "first", "second"))
    folder.mkdir()
    scene.write_frames(folder, 3)
    (tmp_path / "cal.txt").write_text(scene.LISTING)
    options = {
        "left": "ir1_*.png",
        "right": "ir2_*.png",
        "depth": "d_*.png",
        "calibration": str(tmp_path / "cal.txt"),
        "depth_unit": "mm",
    }
    options |= {"emitter": "on", "sensor": "d435", "scene": "desk", "licence": "mine"}
    numbers = {"baseline": 0.0501, "black_level": 4.0, "every": 2, "most_frames": 2}
    flags = [f"--{name.replace('_', '-')}={v}" for name, v in (options | numbers).items()]
    command = ["import", str(folder), "--out", str(first), "--moving", *flags, "--json"]
    assert command_line.main(command) == 0
    printed = json.loads(capsys.readouterr().out)
    imported = starling.import_recording(folder, second, moving=True, **options, **numbers)
    assert imported["frames"] == imported["scenes"] == 2
    for table in (printed, imported):
        del table["seconds"], table["out"]
    assert json.loads(json.dumps(imported)) == printed
    paths = sorted(path.relative_to(first) for path in first.rglob("*") if path.is_file())
    assert len(paths) == 12
    for path in paths:
        assert (second / path).read_bytes() == (first / path).read_bytes(), path
