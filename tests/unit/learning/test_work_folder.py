"""The output folder of long work: continuation, and protection of other files."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from starling.learning.commands import work_folder
from starling.patterns.errors import InputError
from starling.sim.console.output import RECORD

ARGUMENTS = {"method": "trees", "rooms": ("a", "b"), "seed": 0, "captures": Path("set")}
OTHERS = {**ARGUMENTS, "seed": 1}


def _begin(folder: Path, arguments: dict, *, force: bool) -> None:
    with work_folder.opened(folder, arguments, force=force):
        pass


def _refused(folder: Path, arguments: dict, *, force: bool) -> str:
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    with pytest.raises(InputError) as caught:
        _begin(folder, arguments, force=force)
    line = str(caught.value)
    assert "\n" not in line
    assert {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()} == before
    return line


@pytest.mark.parametrize("force", [False, True])
def test_work_starts_in_a_new_or_empty_folder(tmp_path, force):
    (tmp_path / "empty").mkdir()
    for folder in (tmp_path / "new" / "deep", tmp_path / "empty"):
        _begin(folder, ARGUMENTS, force=force)
        assert [path.name for path in folder.iterdir()] == [work_folder.UNFINISHED]
    marker = json.loads((tmp_path / "empty" / work_folder.UNFINISHED).read_text())
    assert marker == {"method": "trees", "rooms": ["a", "b"], "seed": 0, "captures": "set"}


def test_the_same_work_continues(tmp_path):
    _begin(tmp_path, ARGUMENTS, force=False)
    (tmp_path / "model.npz").write_text("half")
    _begin(tmp_path, dict(ARGUMENTS), force=False)
    assert (tmp_path / "model.npz").read_text() == "half"


def test_other_work_needs_force_and_starts_again(tmp_path):
    _begin(tmp_path / "out", ARGUMENTS, force=False)
    (tmp_path / "out" / "model.npz").write_text("half")
    line = _refused(tmp_path / "out", OTHERS, force=False)
    assert line == (
        f"out must hold no other unfinished work; got {tmp_path / 'out'}. "
        "Choose another, or give --force to drop it."
    )
    _begin(tmp_path / "out", OTHERS, force=True)
    assert [path.name for path in (tmp_path / "out").iterdir()] == [work_folder.UNFINISHED]
    assert json.loads((tmp_path / "out" / work_folder.UNFINISHED).read_text())["seed"] == 1


def test_force_also_deletes_the_same_unfinished_work(tmp_path):
    _begin(tmp_path / "out", ARGUMENTS, force=False)
    (tmp_path / "out" / "model.npz").write_text("half")
    _begin(tmp_path / "out", ARGUMENTS, force=True)
    assert [path.name for path in (tmp_path / "out").iterdir()] == [work_folder.UNFINISHED]


def test_the_record_replaces_the_marker(tmp_path):
    _begin(tmp_path, ARGUMENTS, force=False)
    work_folder.end(tmp_path, "train", ARGUMENTS, {"ndp_rate": np.float32(0.25), "auc": np.nan})
    assert [path.name for path in tmp_path.iterdir()] == [RECORD]
    record = json.loads((tmp_path / RECORD).read_text())
    assert record["verb"] == "train"
    assert record["arguments"] == {
        "method": "trees", "rooms": ["a", "b"], "seed": 0, "captures": "set",
    }  # fmt: skip
    assert record["versions"]["numpy"] == np.__version__
    assert record["figures"] == {"ndp_rate": 0.25, "auc": None}


def test_finished_work_needs_force(tmp_path):
    out = tmp_path / "out"
    _begin(out, ARGUMENTS, force=False)
    work_folder.end(out, "train", ARGUMENTS, {})
    line = _refused(out, ARGUMENTS, force=False)
    assert line == (
        f"out must be an empty or new folder; got {out}. Choose another or give --force."
    )
    _begin(out, ARGUMENTS, force=True)
    assert [path.name for path in out.iterdir()] == [work_folder.UNFINISHED]


@pytest.mark.parametrize("force", [False, True])
def test_files_of_others_are_never_removed(tmp_path, force):
    (tmp_path / "thesis").mkdir()
    (tmp_path / "thesis" / "chapter.txt").write_text("years of work")
    line = _refused(tmp_path, ARGUMENTS, force=force)
    assert line == f"out must be an empty or new folder; got {tmp_path}. Choose another one."


@pytest.mark.parametrize("force", [False, True])
def test_a_file_is_refused(tmp_path, force):
    (tmp_path / "out").write_text("a letter")
    with pytest.raises(InputError) as caught:
        _begin(tmp_path / "out", ARGUMENTS, force=force)
    assert str(caught.value) == (
        f"out must be a folder; got the file {tmp_path / 'out'}. Choose another name."
    )
    assert (tmp_path / "out").read_text() == "a letter"


def test_a_record_that_cannot_be_written_is_refused(tmp_path):
    _begin(tmp_path, ARGUMENTS, force=False)
    (tmp_path / RECORD).mkdir()
    with pytest.raises(InputError, match="out must be a file; got the folder"):
        work_folder.end(tmp_path, "train", ARGUMENTS, {})
    assert (tmp_path / work_folder.UNFINISHED).is_file()


@pytest.mark.parametrize("force", [False, True])
def test_a_second_run_in_the_folder_is_refused(tmp_path, force):
    """It would write into the files of the first, and remove its marker."""
    with work_folder.opened(tmp_path / "out", ARGUMENTS, force=False):
        line = _refused(tmp_path / "out", ARGUMENTS, force=force)
        assert line.startswith(f"out must be used by one run at a time; got {tmp_path / 'out'}. ")
    _begin(tmp_path / "out", ARGUMENTS, force=force)


def test_force_keeps_the_target_of_links(tmp_path):
    _begin(tmp_path / "out", ARGUMENTS, force=False)
    (tmp_path / "set").mkdir()
    (tmp_path / "out" / "folds").mkdir()
    (tmp_path / "out" / "link").symlink_to(tmp_path / "set")
    _begin(tmp_path / "out", ARGUMENTS, force=True)
    assert (tmp_path / "set").is_dir()
    assert [path.name for path in (tmp_path / "out").iterdir()] == [work_folder.UNFINISHED]


def test_a_folder_below_a_file_is_refused(tmp_path):
    (tmp_path / "letter").write_text("")
    with pytest.raises(InputError, match=r"out must be writable; got .*letter/out"):
        _begin(tmp_path / "letter" / "out", ARGUMENTS, force=False)
