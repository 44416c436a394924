"""A growing data set on disk: complete tasks are recorded, incomplete ones are repeated."""

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
from starling.sim.datasets.workers import TaskResult

Layout = Literal["folders", "shards"]

PLAN = "plan.toml"  # The plan as read, and everything else that determines the set.
_PARTS = ".parts"  # Folder with the rows of each complete task.
_LOCK = ".lock"


class SetFolder:
    """Writes the results of workers, task by task, in any order."""

    def __init__(self, path: Path, layout: Layout) -> None:
        """Use a folder that `opened` has prepared."""
        self.path, self._layout = path, layout

    def done(self) -> set[int]:
        """Return the numbers of the complete tasks."""
        return {int(part.stem) for part in (self.path / _PARTS).glob("*.json")}

    def put(self, result: TaskResult) -> None:
        """Write the result of a task: first its files, then the mark of completeness.

        Raises:
            InputError: if the disk is full or the folder cannot be written.
        """
        with output.refused(self.path):
            if self._layout == "shards":
                where = shard.name(result.number)
                self._write(where, shard.pack(result.views))
            else:
                where = ""
                for view in result.views:
                    self._write_folder(view.name, view.files)
            summary = {
                "rows": [{**row, "shard": where} for row in result.rows],
                "skipped": list(result.skipped),
            }
            self._write(f"{_PARTS}/{result.number:06d}.json", record.dumps(summary).encode())

    def describe(self, info: CaptureInfo) -> None:
        """Write the set's `capture.toml`."""
        self._write(capture_info.FILE, capture_info.dumps(info).encode())

    def finish(self, summary: Mapping[str, Any]) -> None:
        """Write the index and the record after the last task.

        Args:
            summary: entries of the record; they must be the same in every run.

        Raises:
            InputError: as `put`, or if pyarrow is not installed.
        """
        parts = sorted((self.path / _PARTS).glob("*.json"))
        results = [json.loads(part.read_bytes()) for part in parts]
        frames = [row for result in results for row in result["rows"]]
        skipped = [view for result in results for view in result["skipped"]]
        figures = {
            "frames": len(frames),
            "bytes": sum(row["bytes"] for row in frames),
            "skipped": skipped,
        }
        self._write(index.FILE, index.encode(frames))
        text = record.dumps({**summary, "versions": record.versions(), "figures": figures})
        self._write(output.RECORD, text.encode())
        with output.refused(self.path):
            shutil.rmtree(self.path / _PARTS)

    @property
    def finished(self) -> bool:
        """Whether the index and the record exist."""
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
        shutil.rmtree(self.path / name, ignore_errors=True)  # Left by an incomplete task.
        part.rename(self.path / name)


def figures(path: Path) -> dict[str, Any]:
    """Return the frames, bytes and skipped views of a finished set.

    Raises:
        InputError: if the record is missing or damaged.
    """
    file = path / output.RECORD
    try:
        return json.loads(file.read_bytes())["figures"]
    except (OSError, ValueError, KeyError) as error:
        rule, advice = f"must have its {output.RECORD}", "Is it a finished set of generate?"
        raise errors.refuse("set", rule, f"{path}: {error}", advice) from error


@contextmanager
def opened(path: Path, plan: str, layout: Layout) -> Iterator[SetFolder]:
    """Start or resume a set, and lock it against other runs.

    Args:
        path: folder of the set.
        plan: text of `plan.toml`.
        layout: one folder per view, or archives of many views.

    Raises:
        InputError: if the folder holds other files or the set of another plan, another run uses
            it, or it cannot be written.
    """
    plan_file = path / PLAN
    begun = plan_file.is_file()
    if path.exists() and not begun and (not path.is_dir() or _others(path)):
        advice = "Choose another folder, or empty this one yourself."
        raise errors.refuse("out", "must be a new folder or an unfinished set", path, advice)
    with output.refused(path):
        (path / _PARTS).mkdir(parents=True, exist_ok=True)
        lock = (path / _LOCK).open("w")
    with lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            rule, advice = "must be used by one run at a time", "End the other run, or wait for it."
            raise errors.refuse("out", rule, path, advice) from error
        if begun:
            _refuse_other(plan_file.read_text(encoding="utf-8"), plan, path)
        with output.refused(path):
            if (path / output.RECORD).is_file():
                shutil.rmtree(path / _PARTS)
            for partial in [*path.glob(".*.partial"), *(path / _PARTS).glob(".*.partial")]:
                shutil.rmtree(partial) if partial.is_dir() else partial.unlink()
        if not begun:
            output.write_file(plan_file, plan.encode())
        yield SetFolder(path, layout)


def _others(path: Path) -> list[Path]:
    """Return files that do not come from a run killed before it wrote its plan."""
    return [
        item
        for item in path.iterdir()
        if item.name not in (_PARTS, _LOCK) and not item.name.endswith(".partial")
    ]


def _refuse_other(before: str, now: str, path: Path) -> None:
    if before == now:
        return
    lines = difflib.unified_diff(before.splitlines(), now.splitlines(), n=0, lineterm="")
    changed = [line for line in lines if line[:1] in "+-" and line[:3] not in ("+++", "---")]
    advice = "Choose another folder, or the plan that started the set."
    raise errors.refuse("plan", f"must be that of {path}", "; ".join(changed), advice)
