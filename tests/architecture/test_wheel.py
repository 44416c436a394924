"""The wheel carries exactly the program and works in a clean environment."""

from __future__ import annotations

import shutil
import subprocess
import sys
import sysconfig
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PROTOCOL = ROOT / "diagnosis" / "validation" / "protocol"
PACKAGES = ("patterns", "sim", "calibration", "learning", "diagnosis")
IMPORT_ALL = """
import importlib, pkgutil
import starling
names = [module.name for module in pkgutil.walk_packages(starling.__path__, "starling.")]
names.insert(0, "starling")
print(*(importlib.import_module(name).__file__ for name in names))
"""


def _sources() -> set[Path]:
    """Every module of the program."""
    return {*(ROOT / "starling").glob("*.py")}.union(
        *((ROOT / name).rglob("*.py") for name in PACKAGES)
    )


def _run(*command: str | Path, cwd: Path) -> str:
    run = subprocess.run(command, cwd=cwd, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stdout + run.stderr
    return run.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build from a copy, so that nothing is left in the tree and no old build leaks in."""
    copy = tmp_path_factory.mktemp("source")
    for name in (*PACKAGES, "tests", "examples"):  # The last two must not get into the wheel.
        skip = shutil.ignore_patterns("__pycache__")
        shutil.copytree(ROOT / name, copy / name, ignore=skip)
    (copy / "starling").mkdir()
    for path in (ROOT / "starling").iterdir():
        if path.is_symlink() or path.suffix == ".py":
            shutil.copy(path, copy / "starling" / path.name, follow_symlinks=False)
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, copy / name)
    _run(sys.executable, "-m", "build", "--wheel", "--no-isolation", cwd=copy)
    (built,) = (copy / "dist").glob("*.whl")
    return built


def test_wheel_holds_exactly_the_program(wheel: Path) -> None:
    files = _sources().union(*((ROOT / name).rglob("*.toml") for name in PACKAGES))
    files |= {*(ROOT / "learning" / "shipped").glob("*/*")}
    files |= {PROTOCOL / "detection.json", PROTOCOL / "detection_imperfect.json"}
    inside = {path.relative_to(ROOT).as_posix().removeprefix("starling/") for path in files}
    expected = {f"starling/{name}" for name in inside}
    held = {name for name in zipfile.ZipFile(wheel).namelist() if ".dist-info/" not in name}
    assert held == expected


def test_installed_wheel_imports_and_answers(wheel: Path, tmp_path: Path) -> None:
    """Install into a fresh environment that sees this one's libraries, not the source tree."""
    _run(sys.executable, "-m", "venv", "--without-pip", tmp_path / "venv", cwd=tmp_path)
    python = tmp_path / "venv" / "bin" / "python"
    installer = (sys.executable, "-m", "pip", "--python", python)
    _run(*installer, "install", "--quiet", "--no-deps", "--no-index", wheel, cwd=tmp_path)
    where = "import sysconfig; print(sysconfig.get_paths()['purelib'])"
    site = Path(_run(python, "-c", where, cwd=tmp_path).strip())
    # A path file would also run the libraries' own path files and with them the editable install
    # of the source tree; a path set by hand does not.
    libraries = sysconfig.get_paths()["purelib"]
    (site / "libraries.pth").write_text(f"import sys; sys.path.append({libraries!r})\n")

    places = _run(python, "-c", IMPORT_ALL, cwd=tmp_path).split()
    assert len(places) == len(_sources())
    assert [place for place in places if not place.startswith(str(site))] == []
    presets = "import starling; print(*map(starling.load_sensor, starling.list_sensors()))"
    _run(python, "-c", presets, cwd=tmp_path)
    assert "simulate" in _run(tmp_path / "venv" / "bin" / "starling", "--help", cwd=tmp_path)
