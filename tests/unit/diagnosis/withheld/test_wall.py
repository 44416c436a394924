"""The wall of the withheld camera: it may read nothing that the simulator is made of."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

from starling.diagnosis.validation.camera.errors import WithheldError, refusal

ROOT = Path(__file__).parents[4]
# What Blender's interpreter runs, a process of its own, and what it may import beside all others.
SCRIPT = ROOT / "diagnosis" / "validation" / "camera" / "cycles" / "render_with_blender.py"
BLENDER = {"bpy", "bpy_extras", "mathutils"}
OF_SCRIPT = {*BLENDER, "tempfile"}
# What hands light from one side to the other; it names no effect.
CARRIERS = {"cycles_job.py", "cycles_light.py"}
VALIDATION = ROOT / "diagnosis" / "validation"
WALLED = tuple(f"starling.diagnosis.validation.{part}" for part in ("camera", "protocol"))
ADAPTERS = {*(VALIDATION / "adapters").glob("*.py")}
FILES = sorted({*VALIDATION.rglob("*.py")} - ADAPTERS - {SCRIPT})
STANDARD = {
    "__future__",
    "argparse",
    "collections",
    "concurrent",
    "contextlib",
    "dataclasses",
    "fcntl",
    "functools",
    "hashlib",
    "itertools",
    "json",
    "math",
    "multiprocessing",
    "os",
    "pathlib",
    "re",
    "shutil",
    "subprocess",
    "sys",
    "textwrap",
    "time",
    "typing",
    "zipfile",
}
LIBRARIES = {"numpy", "scipy", "cv2"}


def _imports(path: Path) -> set[str]:
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path.name} imports relatively"
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
        elif isinstance(node, ast.Call) and ast.unparse(node.func).endswith(
            ("import_module", "__import__")
        ):
            found.add("an import by name")
    return found


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_imports_stay_inside_the_wall(path: Path) -> None:
    for name in _imports(path):
        own = name.startswith("starling.diagnosis.validation")
        own = own and not name.startswith("starling.diagnosis.validation.adapters")
        captures = f"{name}.".startswith("starling.sim.captures.capture.")
        assert own or captures or name.split(".")[0] in STANDARD | LIBRARIES, name


def test_the_diagnosis_reads_nothing_of_the_withheld_camera() -> None:
    own = {*(ROOT / "diagnosis").rglob("*.py")} - {*FILES, SCRIPT}
    for path in own:
        read = {name for name in _imports(path) if name.startswith(WALLED)}
        assert not read or path.name in CARRIERS, path


def test_blenders_script_imports_blender_and_numpy_alone() -> None:
    tops = {name.split(".")[0] for name in _imports(SCRIPT)}
    assert tops <= STANDARD | OF_SCRIPT | {"numpy"}


def test_nothing_else_imports_blender_or_the_script() -> None:
    """Its licence is another: it runs elsewhere, and files go to and fro."""
    rooms = ("patterns", "sim", "calibration", "learning", "diagnosis")
    for path in {p for room in rooms for p in (ROOT / room).rglob("*.py")} - {SCRIPT}:
        text = path.read_text(encoding="utf-8")
        if "bpy" in text or SCRIPT.stem in text:
            names = {part for name in _imports(path) for part in name.split(".")}
            assert not names & {*BLENDER, SCRIPT.stem}, path


def test_captures_are_read_where_they_come_from_alone() -> None:
    readers = [path.name for path in FILES if any("sim." in name for name in _imports(path))]
    assert readers == ["real_pairs.py", "shoot.py"]


def test_no_global_generator() -> None:
    for path in FILES:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Attribute):
                name = ast.unparse(node)
                if name.startswith("np.random."):
                    allowed = {"np.random.Generator", "np.random.SeedSequence", "np.random.SFC64"}
                    assert name in allowed, f"{path.name}: {name}"


def test_a_refusal_is_one_line() -> None:
    error = refusal("gain", "must be > 0", -1, "Give a factor.")
    assert isinstance(error, WithheldError) and isinstance(error, ValueError)
    assert str(error) == "gain must be > 0; got -1. Give a factor."
