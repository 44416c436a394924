"""The wall of the second camera: it must not import the simulator."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

from starling.diagnosis.validation.camera.errors import WithheldError, refusal

ROOT = Path(__file__).parents[4]
# The script that Blender's interpreter runs, and the modules that only it may import.
SCRIPT = ROOT / "diagnosis" / "validation" / "camera" / "cycles" / "render_with_blender.py"
BLENDER = {"bpy", "bpy_extras", "mathutils"}
SCRIPT_MODULES = {*BLENDER, "tempfile"}
# The command line, and the adapter that transfers light between both sides; they name no effect.
CARRIERS = {"__main__.py", "cycles_light.py"}
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
    "importlib",
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
    "threading",
    "time",
    "typing",
    "warnings",
    "zipfile",
}
LIBRARIES = {"numpy", "scipy", "cv2"}


def _imports(path: Path) -> set[str]:
    names = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path.name} has a relative import"
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
        elif isinstance(node, ast.Call) and ast.unparse(node.func).endswith(
            ("import_module", "__import__")
        ):
            names.add("an import by name")
    return names


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_imports_stay_inside_the_wall(path: Path) -> None:
    for name in _imports(path):
        inside = name.startswith("starling.diagnosis.validation")
        inside = inside and not name.startswith("starling.diagnosis.validation.adapters")
        captures = f"{name}.".startswith("starling.sim.captures.capture.")
        assert inside or captures or name.split(".")[0] in STANDARD | LIBRARIES, name


def test_the_diagnosis_does_not_import_the_second_camera() -> None:
    for path in {*(ROOT / "diagnosis").rglob("*.py")} - {*FILES, SCRIPT}:
        walled = {name for name in _imports(path) if name.startswith(WALLED)}
        assert not walled or path.name in CARRIERS, path


def test_the_blender_script_imports_only_blender_and_numpy() -> None:
    tops = {name.split(".")[0] for name in _imports(SCRIPT)}
    assert tops <= STANDARD | SCRIPT_MODULES | {"numpy"}


def test_no_other_module_imports_blender_or_the_script() -> None:
    """Blender has another licence. It runs in a separate process and exchanges files."""
    packages = ("patterns", "sim", "calibration", "learning", "diagnosis")
    for path in {p for package in packages for p in (ROOT / package).rglob("*.py")} - {SCRIPT}:
        text = path.read_text(encoding="utf-8")
        if "bpy" in text or SCRIPT.stem in text:
            names = {part for name in _imports(path) for part in name.split(".")}
            assert not names & {*BLENDER, SCRIPT.stem}, path


def test_only_two_modules_read_captures() -> None:
    readers = [path.name for path in FILES if any("sim." in name for name in _imports(path))]
    assert readers == ["real_pairs.py", "shoot.py"]


def test_no_global_random_generator() -> None:
    for path in FILES:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Attribute):
                name = ast.unparse(node)
                if name.startswith("np.random."):
                    allowed = {"np.random.Generator", "np.random.SeedSequence", "np.random.SFC64"}
                    assert name in allowed, f"{path.name}: {name}"


def test_an_error_is_one_line() -> None:
    error = refusal("gain", "must be > 0", -1, "Give a factor.")
    assert isinstance(error, WithheldError) and isinstance(error, ValueError)
    assert str(error) == "gain must be > 0; got -1. Give a factor."
