"""A data set on disk while it grows: what is there is whole, and what is not is made again."""

from __future__ import annotations

import difflib
import fcntl
import json
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal

from starling.patterns import errors
from starling.sim.captures import info as capture_info
from starling.sim.captures.info import CaptureInfo
from starling.sim.console import output, record
from starling.sim.datasets import index, shard
from starling.sim.datasets.task import Made

Layout = Literal["folders", "shards"]

PLAN = "plan.toml"  # As it was read, with what else the set follows from.
_PARTS = ".parts"  # Rows of each task that is whole on disk.
_LOCK = ".lock"


class SetFolder:
    """Takes what workers made, task by task, in any order."""

    def __init__(self, path: Path, layout: Layout) -> None:
        """Of a folder that `opened` has opened."""
        self.path, self._layout = path, layout

    def done(self) -> set[int]:
        """Numbers of the tasks that are whole on disk."""
        return {int(part.stem) for part in (self.path / _PARTS).glob("*.json")}

    def put(self, made: Made) -> None:
        """Write what was made of a task: first its files, then that they are there.

        Raises:
            InputError: if the disk is full or the folder cannot be written.
        """
        with output.refused(self.path):
            if self._layout == "shards":
                where = shard.name(made.number)
                self._write(where, shard.packed(made.views))
            else:
                where = ""
                for view in made.views:
                    self._write_folder(view.name, view.files)
            told = {
                "rows": [{**row, "shard": where} for row in made.rows],
                "skipped": list(made.skipped),
            }
            self._write(f"{_PARTS}/{made.number:06d}.json", record.dumps(told).encode())

    def describe(self, info: CaptureInfo) -> None:
        """Write the set's `capture.toml`."""
        self._write(capture_info.FILE, capture_info.dumps(info).encode())

    def finish(self, summary: Mapping[str, Any]) -> None:
        """Write the index and the record, once all tasks are done.

        Args:
            summary: goes to the record; nothing in it may differ from run to run.

        Raises:
            InputError: as `put`, or if pyarrow is not installed.
        """
        parts = sorted((self.path / _PARTS).glob("*.json"))
        told = [json.loads(part.read_bytes()) for part in parts]
        frames = [row for one in told for row in one["rows"]]
        skipped = [view for one in told for view in one["skipped"]]
        figures = {
            "frames": len(frames),
            "bytes": sum(row["bytes"] for row in frames),
            "skipped": skipped,
        }
        self._write(index.FILE, index.encoded(frames))
        text = record.dumps({**summary, "versions": record.versions(), "figures": figures})
        self._write(output.RECORD, text.encode())
        with output.refused(self.path):
            shutil.rmtree(self.path / _PARTS)

    @property
    def finished(self) -> bool:
        """Whether index and record are there."""
        return (self.path / output.RECORD).is_file()

    def _write(self, name: str, data: bytes) -> None:
        output.write_file(self.path / name, data, force=True)

    def _write_folder(self, name: str, files: Mapping[str, bytes]) -> None:
        part = self.path / f".{name}.partial"
        shutil.rmtree(part, ignore_errors=True)
        for path, data in files.items():
            file = part / Path(path).relative_to(name)
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(data)
        shutil.rmtree(self.path / name, ignore_errors=True)  # Of a task that was not whole.
        part.rename(self.path / name)


def figures(path: Path) -> dict[str, Any]:
    """Frames, bytes, and views that were skipped, of a finished set.

    Raises:
        InputError: if its record is missing or damaged.
    """
    file = path / output.RECORD
    try:
        return json.loads(file.read_bytes())["figures"]
    except (OSError, ValueError, KeyError) as error:
        rule, advice = f"must have its {output.RECORD}", "Is it a finished set of generate?"
        raise errors.refuse("set", rule, f"{path}: {error}", advice) from error


@contextmanager
def opened(path: Path, plan: str, layout: Layout) -> Iterator[SetFolder]:
    """Begin a set, or go on with one, alone.

    Args:
        path: folder of the set.
        plan: text of all that the set follows from.
        layout: a folder each view, or archives of many.

    Raises:
        InputError: if the folder holds something else or the set of another plan, another run
            works on it, or it cannot be written.
    """
    asked = path / PLAN
    begun = asked.is_file()
    if path.exists() and not begun and (not path.is_dir() or _others(path)):
        advice = "Choose another, or empty it yourself."
        raise errors.refuse("out", "must be a new folder or a set that was begun", path, advice)
    with output.refused(path):
        (path / _PARTS).mkdir(parents=True, exist_ok=True)
        lock = (path / _LOCK).open("w")
    with lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            rule, advice = "must be made by one run at a time", "End the other, or wait for it."
            raise errors.refuse("out", rule, path, advice) from error
        if begun:
            _refuse_other(asked.read_text(encoding="utf-8"), plan, path)
        with output.refused(path):
            if (path / output.RECORD).is_file():
                shutil.rmtree(path / _PARTS)
            for left in [*path.glob(".*.partial"), *(path / _PARTS).glob(".*.partial")]:
                shutil.rmtree(left) if left.is_dir() else left.unlink()
        if not begun:
            output.write_file(asked, plan.encode())
        yield SetFolder(path, layout)


def _others(path: Path) -> list[Path]:
    """What a run that was killed before its plan stood there cannot have left."""
    return [
        one
        for one in path.iterdir()
        if one.name not in (_PARTS, _LOCK) and not one.name.endswith(".partial")
    ]


def _refuse_other(before: str, now: str, path: Path) -> None:
    if before == now:
        return
    lines = difflib.unified_diff(before.splitlines(), now.splitlines(), n=0, lineterm="")
    changed = [line for line in lines if line[:1] in "+-" and line[:3] not in ("+++", "---")]
    advice = "Choose another folder, or the plan that it was begun with."
    raise errors.refuse("plan", f"must be that of {path}", "; ".join(changed), advice)
