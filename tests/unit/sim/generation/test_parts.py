"""Records of the complete tasks of an unfinished set: damage is refused before work continues."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from starling.patterns.errors import InputError
from starling.sim.datasets.set_folder import SetFolder
from starling.sim.datasets.workers import Task
from tests.unit.sim.generation.test_index import ROW

FRAMES = 2
TASKS = [Task(number=0, views=(0, 1)), Task(number=1, views=(2, 3))]
Damage = Callable[[Path], object]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """An unfinished set of two complete tasks, whose view 3 was skipped."""
    for task in TASKS:
        rows = []
        for view in task.views[: 2 - task.number]:
            for repeat in range(FRAMES):
                name = f"{view}/{repeat}/depth.png"
                (tmp_path / name).parent.mkdir(parents=True)
                (tmp_path / name).touch()
                place = {"view": view, "repeat": repeat, "frame": view * FRAMES + repeat}
                rows.append({**ROW, **place, "files": [name]})
        _write(tmp_path, task.number, rows, [{"view": 3, "why": "gone"}] * task.number)
    return tmp_path


def _write(folder: Path, number: int, rows: list[Any], skipped: list[Any]) -> None:
    path = _part(folder, number)
    path.parent.mkdir(exist_ok=True)
    path.write_text(json.dumps({"rows": rows, "skipped": skipped}))


def _part(folder: Path, number: int) -> Path:
    return folder / ".parts" / f"{number:06d}.json"


def test_whole_parts_are_complete_tasks(folder: Path) -> None:
    assert SetFolder(folder, "folders").done(TASKS, FRAMES) == {0, 1}


@pytest.mark.parametrize(
    "damage",
    [
        pytest.param(lambda at: shutil.copy(_part(at, 0), _part(at, 1)), id="of another task"),
        pytest.param(lambda at: shutil.copy(_part(at, 0), _part(at, 7)), id="of no task"),
        pytest.param(lambda at: _part(at, 0).rename(at / ".parts/\u0660.json"), id="other digits"),
        pytest.param(lambda at: _write(at, 1, [], []), id="without rows"),
        pytest.param(
            lambda at: _write(at, 1, [], [{"view": n, "why": ""} for n in range(4)]),
            id="skips views of another task",
        ),
        pytest.param(lambda at: _write(at, 1, [{**ROW, "frame": 3}] * 2, []), id="wrong frames"),
    ],
)
def test_parts_of_another_task_are_refused(folder: Path, damage: Damage) -> None:
    damage(folder)
    with pytest.raises(
        InputError, match=r"part of the set must be whole; .* another task\. Delete"
    ):
        SetFolder(folder, "folders").done(TASKS, FRAMES)


def test_missing_files_of_a_complete_task_are_refused(folder: Path) -> None:
    (folder / "1/0/depth.png").unlink()
    with pytest.raises(InputError, match=r"000000\.json: 1/0/depth\.png is missing\. Delete it"):
        SetFolder(folder, "folders").done(TASKS, FRAMES)
