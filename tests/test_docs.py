"""Documentation tests: tutorial commands, README code, tables of codes, links."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from starling.sim.reason import LABELS

ROOT = Path(__file__).parents[1]
_LONG = {  # Up to a minute each.
    *("02-what-a-real-camera-adds", "03-new-camera", "04-calibrate"),
    *("05-learn-the-holes", "06-diagnose", "07-data-sets", "08-complete-depth"),
    *("09-validate-the-diagnosis", "10-your-simulator", "11-sensor-files", "12-mujoco"),
    *("13-scene-files", "14-recordings", "15-virtual-realsense"),
}
_NEEDED = {"15-virtual-realsense": "pyrealsense2"}  # Packages that do not load on all machines.
TUTORIALS = [
    pytest.param(page, id=page.stem, marks=[pytest.mark.long] * (page.stem in _LONG))
    for page in sorted((ROOT / "docs" / "tutorial").glob("*.md"))
]


def _blocks(page: Path, language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", page.read_text("utf-8"), re.DOTALL)


def _run(*command: str | Path, cwd: Path) -> str:
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "MPLBACKEND": "Agg"}
    run = subprocess.run(
        command, cwd=cwd, env=environment, capture_output=True, text=True, check=False
    )
    assert run.returncode == 0, run.stderr
    return run.stdout


def test_readme_code_runs(tmp_path: Path) -> None:
    (code,) = _blocks(ROOT / "README.md", "python")
    _run(sys.executable, "-c", code, cwd=tmp_path)


@pytest.mark.parametrize("page", TUTORIALS)
def test_tutorial_commands_run(page: Path, tmp_path: Path) -> None:
    """Run a page's shell blocks in order, in one folder."""
    if page.stem in _NEEDED:
        pytest.importorskip(_NEEDED[page.stem], exc_type=ImportError)
    program = tmp_path / "bin" / "starling"
    program.parent.mkdir()
    program.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m starling "$@"\n')
    program.chmod(0o755)
    blocks = _blocks(page, "sh")
    assert blocks
    script = f'PATH="{program.parent}:$PATH"\n' + "\n".join(blocks)
    _run("sh", "-e", "-c", script, cwd=tmp_path)
    for code in _blocks(page, "python"):
        if "--8<--" not in code:  # Examples have tests of their own.
            _run(sys.executable, "-c", code, cwd=tmp_path)


def test_pages_write_to_separate_folders() -> None:
    """Pages run in order in one folder, so no page may write into another page's output."""
    pages = [ROOT / "README.md", *sorted((ROOT / "docs" / "tutorial").glob("*.md"))]
    written: dict[str, set[str]] = {}
    for page in pages:
        text = page.read_text("utf-8")
        image = re.findall(r"(?:--out|cp -r .*|cat >) ([\w./$-]+)(?=[`\s])", text)
        for target in image:
            # `calibrate --out NAME.toml` makes the folder NAME too.
            written.setdefault(target.removesuffix(".toml").rstrip("/"), set()).add(page.name)
    assert {"out/first", "out/real", "out/cam", "plan"} <= written.keys()
    assert {target: names for target, names in written.items() if len(names) > 1} == {}


def test_conventions_list_every_reason() -> None:
    page = (ROOT / "docs" / "conventions.md").read_text("utf-8")
    listed = re.findall(r"^\| (\d+) \| ([^|]+) \|", page, re.MULTILINE)
    assert [(int(code), label) for code, label in listed] == [
        (reason.value, label) for reason, label in LABELS.items()
    ]


def test_glossary_defines_each_word_once() -> None:
    page = (ROOT / "docs" / "glossary.md").read_text("utf-8")
    words = re.findall(r"^\*\*(.+)\*\*$", page, re.MULTILINE)
    assert len(words) == len(set(words))
    assert [word for word in words if "NDP (" in word] == ["NDP (no-depth pixel)"]


def test_links_have_targets() -> None:
    """Checks links between pages, and to pictures once they exist."""
    broken = []
    for page in [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").rglob("*.md")]:
        for target in re.findall(r"\]\(([^)#\s]+)", page.read_text("utf-8")):
            if "://" not in target and not (page.parent / target).exists():
                broken.append(f"{page.relative_to(ROOT)}: {target}")
    assert not broken
