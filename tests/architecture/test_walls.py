"""The walls: which room may import which, and where heavy libraries may live.

Every exception stands in a table below with its reason.
"""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]

# Each room and what it may import; everything may import itself.
ROOMS = {
    "patterns": set(),
    "sim": {"patterns"},
    "calibration": {"sim", "patterns"},
    "learning": {"sim", "patterns"},
    "diagnosis": {"calibration", "learning", "sim", "patterns"},
    "starling": {"diagnosis", "calibration", "learning", "sim", "patterns"},
}
# Libraries that may be imported only in some rooms.
LIBRARY_ROOMS = {
    "mitsuba": {"sim"},
    "drjit": {"sim", "calibration"},
    "torch": {"learning"},
    "sklearn": {"diagnosis", "learning"},
    "diffusers": {"learning"},
    "transformers": {"learning"},
    "huggingface_hub": {"learning"},
}
# The files that make pictures, and which pictures.
PICTURE_MAKERS: dict[str, str] = {
    "sim/plotting/sheet.py": "every picture: an empty figure, and its file; sheets of panels",
    "sim/plotting/panels.py": "the panels",
    "sim/commands/sweep/picture.py": "the curves of a sweep",
    "sim/commands/check_sensors/picture.py": "noise of cameras against distance",
    "learning/evaluation/pictures.py": "the curves of an evaluation",
    "learning/judge/pictures.py": "scores and windows of the judge",
    "learning/completion/evaluation/pictures.py": "errors of completed depth",
}
HEAVY = ("mitsuba", "drjit", "torch", "sklearn", "cv2", "matplotlib", "scipy", "numba")
LONGEST_FILE = 400


def _room(path: Path) -> str:
    return path.relative_to(ROOT).parts[0]


def _room_of(module: str) -> str:
    """Return the room of an import: `sim` for `starling.sim.scene`, `numpy` for `numpy.linalg`."""
    first, *rest = module.split(".")
    return rest[0] if first == "starling" and rest and rest[0] in ROOMS else first


def _sources() -> list[Path]:
    return sorted(path for room in ROOMS for path in (ROOT / room).rglob("*.py"))


def _tracked() -> list[Path]:
    """Return every file git tracks or would add; skip outside a git checkout."""
    try:
        listed = subprocess.run(
            ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
            cwd=ROOT,
            capture_output=True,
            check=True,
            text=True,
        ).stdout
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("not a git checkout")
    return [ROOT / name for name in listed.split("\0") if name and (ROOT / name).is_file()]


@cache
def _imports(path: Path, top_level_only: bool = False) -> tuple[tuple[int, str], ...]:
    """Return (line, absolute module) of every import, `import_module("x")` included."""
    return tuple(_find_imports(path, top_level_only))


def _find_imports(path: Path, top_level_only: bool) -> Iterator[tuple[int, str]]:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    package = list(path.relative_to(ROOT).parent.parts)
    for node in _at_import(tree) if top_level_only else ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) + 1 - node.level] if node.level else []
            module = ".".join([*base, *([node.module] if node.module else [])])
            if module == "starling":
                yield from ((node.lineno, f"starling.{alias.name}") for alias in node.names)
            else:
                yield node.lineno, module
        elif isinstance(node, ast.Call) and node.args:
            name = ast.unparse(node.func)
            first = node.args[0]
            if name.endswith(("import_module", "__import__")) and isinstance(first, ast.Constant):
                yield node.lineno, str(first.value)


def _at_import(tree: ast.AST) -> Iterator[ast.AST]:
    """Walk what runs when the module is imported: not functions, not `if TYPE_CHECKING`."""
    for node in ast.iter_child_nodes(tree):
        checking = isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test)
        if not checking and not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            yield node
            yield from _at_import(node)


def _breaches(allowed: dict[str, set[str]], walled: set[str]) -> list[str]:
    """List imports of `walled` modules from rooms that may not have them."""
    found = []
    for path in _sources():
        for line, module in _imports(path):
            top = _room_of(module)
            if top in walled and top != _room(path) and top not in allowed[_room(path)]:
                found.append(f"{path.relative_to(ROOT)}:{line} imports {module}")
    return found


def test_rooms_import_one_way() -> None:
    assert not _breaches(ROOMS, set(ROOMS))


def test_no_room_imports_tests_or_examples() -> None:
    nothing: dict[str, set[str]] = {room: set() for room in ROOMS}
    assert not _breaches(nothing, {"tests", "examples", "benchmarks", "tools"})


def test_heavy_libraries_stay_in_their_rooms() -> None:
    allowed = {room: {lib for lib, at in LIBRARY_ROOMS.items() if room in at} for room in ROOMS}
    assert not _breaches(allowed, set(LIBRARY_ROOMS))


def test_matplotlib_only_where_pictures_are_made() -> None:
    found = {
        path.relative_to(ROOT).as_posix()
        for path in _sources()
        for _, module in _imports(path)
        if module.split(".")[0] == "matplotlib"
    }
    assert not found - set(PICTURE_MAKERS)


def test_variant_is_chosen_in_one_file() -> None:
    """Mitsuba's variant is global: a second place that sets it would pull the rug away."""
    setters = [
        path.relative_to(ROOT).as_posix()
        for path in _sources()
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Attribute) and node.attr == "set_variant"
    ]
    assert set(setters) <= {"sim/render/backend.py"}


def test_packages_are_imported_by_their_full_names() -> None:
    """`import starling.sim` would be a second copy of `starling.sim`."""
    found = [
        f"{path.relative_to(ROOT)}:{line} imports {module}"
        for path in _tracked()
        if path.suffix == ".py"
        for line, module in _imports(path)
        if module.split(".")[0] in {*ROOMS} - {"starling"}
    ]
    assert not found


@pytest.mark.parametrize("room", ["starling", "starling.patterns", "starling.sim"])
def test_import_loads_nothing_heavy(room: str) -> None:
    """Heavy libraries load inside the functions that need them."""
    code = f"import sys, {room}; print(*(m for m in {HEAVY!r} if m in sys.modules))"
    run = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert run.returncode == 0, run.stderr
    assert run.stdout.split() == []


def test_front_door_imports_nothing_heavy_at_top_level() -> None:
    tops = {
        module.split(".")[0] for _, module in _imports(ROOT / "starling" / "command_line.py", True)
    }
    assert not tops & {*HEAVY, "OpenEXR", "colour", "trimesh"}


def test_files_are_short() -> None:
    """A file is one concept and is read in one sitting."""
    lengths = {
        path.relative_to(ROOT).as_posix(): len(path.read_text(encoding="utf-8").splitlines())
        for path in _tracked()
        if path.suffix == ".py"
    }
    del lengths["starling/__init__.py"]  # The public interface on one page, mostly docstrings.
    assert {name: n for name, n in lengths.items() if n >= LONGEST_FILE} == {}


# Written so that this file does not find itself.
_MACHINE = re.compile(
    r"(?<![\w.~$)}-])/(?:work|home/\w|Users/\w|root|mnt|media|srv)(?:/|\b)"  # somebody's folders
    r"|index[-]url|find[-]links"  # where packages come from is the machine's own setting
    r"|https?://(?:files|registry|deb|index|static|pypi)[.]"
)


def test_no_machine_paths_or_registries_in_tracked_files() -> None:
    found = []
    for path in _tracked():
        try:
            text = path.read_text(encoding="utf-8")
        except UnicodeDecodeError:
            continue  # Pictures.
        for number, line in enumerate(text.splitlines(), 1):
            if _MACHINE.search(line):
                found.append(f"{path.relative_to(ROOT)}:{number}: {line.strip()[:100]}")
    assert not found
