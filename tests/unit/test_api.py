"""The public interface `import starling`: complete, lazy, typed, and every example runs."""

from __future__ import annotations

import ast
import dataclasses
import doctest
import pydoc
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import starling

SMALL = (  # Half as many pixels on the same chip.
    *("width=424", "height=240", "fx_px=215", "fy_px=215", "cx_px=211.5", "cy_px=119.5"),
    "imager.pixel_pitch_m=8.98e-6",
)
PLAN = """
seed = 7
scenes = 2
views = 1
[[source]]
kind = "builtin"
scene = "wall"
number = 1.0
[[sensor]]
preset = "d435"
[sensor.set]
width = 160
height = 96
fx_px = 80
fy_px = 80
cx_px = 79.5
cy_px = 47.5
"""
CAMERA_INFO = """
image_width: 424
image_height: 240
camera_matrix: {rows: 3, cols: 3, data: [215, 0, 211.5, 0, 215, 119.5, 0, 0, 1]}
"""
FUNCTIONS = [name for name in starling.__all__ if name not in starling._CLASSES]
MINUTES = {"diagnose"}


def _marked(name: str) -> object:
    return pytest.param(name, marks=pytest.mark.long) if name in MINUTES else name


@pytest.mark.parametrize("name", [_marked(name) for name in FUNCTIONS])
def test_example_runs(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "plan.toml").write_text(PLAN, encoding="utf-8")
    (tmp_path / "camera.yaml").write_text(CAMERA_INFO, encoding="utf-8")
    names = {"starling": starling, "np": np, "SMALL": SMALL}
    names |= {"PLAN": "plan.toml", "CAMERA_INFO": "camera.yaml"}
    function = getattr(starling, name)
    example = doctest.DocTestParser().get_doctest(function.__doc__, names, name, None, 0)
    assert example.examples, f"{name} has no example"
    report: list[str] = []
    results = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS).run(example, out=report.append)
    assert results.failed == 0, "".join(report)


def test_every_class_is_found_where_the_table_says() -> None:
    for name, module in starling._CLASSES.items():
        assert getattr(starling, name).__module__ == module


def test_type_checkers_see_the_classes_of_the_table() -> None:
    tree = ast.parse(Path(str(starling.__file__)).read_text(encoding="utf-8"))
    (block,) = (node for node in tree.body if isinstance(node, ast.If))
    seen = {
        alias.asname: node.module
        for node in block.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
        if alias.asname
    }
    assert seen == starling._CLASSES


def test_wrong_name_names_the_nearest() -> None:
    with pytest.raises(AttributeError, match=r"no attribute 'load_senor'\. Nearest: load_sensor"):
        _ = starling.load_senor


def test_packages_are_attributes() -> None:
    assert starling.patterns.__name__ == "starling.patterns"
    assert {"simulate", "Sensor", "patterns"} <= {*dir(starling)}


def test_import_is_quick_and_loads_no_library() -> None:
    code = "import sys, starling; print(*{'numpy', 'tyro', 'mitsuba', 'torch'} & {*sys.modules})"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.split() == []


def test_import_works_beside_packages_of_the_same_names(tmp_path: Path) -> None:
    """A robotics repository may have its own `sim/`."""
    for name in ("sim", "patterns", "calibration", "learning", "diagnosis"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").write_text("raise ImportError('not this one')\n")
    script = tmp_path / "robot.py"
    script.write_text("import starling\nprint(starling.load_sensor('d435').name)\n")
    run = subprocess.run(
        [sys.executable, script], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert (run.returncode, run.stdout.strip()) == (0, "d435"), run.stderr


def test_masks_and_other_types_of_images_are_not_ignored():
    depth_m = np.full((32, 32), 1.0)
    depth_m[:4] = 9.0
    image = np.zeros((32, 32), np.uint8)
    filled = starling.complete(image, np.ma.masked_greater(depth_m, 5), method="nearest")
    assert filled.depth_m.max() == 1.0
    listed: Any = depth_m.tolist()
    assert starling.complete(image, listed, method="nearest").depth_m.max() == 9.0
    for wrong in ("depth.png", depth_m.astype(object), None):
        with pytest.raises(starling.InputError, match="depth_m must be an array of real numbers"):
            starling.complete(image, wrong, method="nearest")  # type: ignore[arg-type]
    sensor = starling.load_sensor("d435", edits=SMALL)
    with pytest.raises(starling.InputError, match="must both be uint8 or uint16; got float64"):
        starling.match(np.ma.masked_array(image, image == 0), image, sensor)
    for wrong in ("left.png", None):
        with pytest.raises(starling.InputError, match="ir_left must be an array of real numbers"):
            starling.match(wrong, image, sensor)  # type: ignore[arg-type]


def test_help_explains_every_field_of_a_reading_and_every_reason() -> None:
    """Comments of fields are not part of `help`."""
    reading, reason = (str(pydoc.render_doc(each)) for each in (starling.Reading, starling.Reason))
    for field in dataclasses.fields(starling.Reading):
        assert re.search(rf"\n \|      {field.name}: \S", reading)
    for code in starling.Reason:
        assert re.search(rf"\n \|      {code.name}: {code.value}\. [A-Z]", reason)
