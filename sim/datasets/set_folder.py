"""A growing data set on disk: complete tasks are recorded, incomplete ones are repeated."""

from __future__ import annotations

import difflib
import re
import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from hashlib import sha256
from pathlib import Path
from typing import Any, Literal

from starling.patterns import errors
from starling.sim import files
from starling.sim.captures import info as capture_info
from starling.sim.captures.info import CaptureInfo
from starling.sim.console import lock, output, record
from starling.sim.datasets import index, shard
from starling.sim.datasets.render_view import RenderedView, write_files
from starling.sim.datasets.workers import Task, TaskResult
from starling.sim.sensor import structure

Layout = Literal["folders", "shards"]

PLAN = "plan.toml"  # The plan as read, and everything else that determines the set.
CHECKSUMS = "SHA256SUMS"  # Of the set's own files, as `sha256sum -c` reads it.
OWN_FILES = (capture_info.FILE, PLAN, index.FILE, output.RECORD)
_HEX = re.compile("[0-9a-f]{64}")
_PARTS = ".parts"  # Folder with the rows of each complete task.
_LOCK = ".lock"  # Of version 0.1.


@dataclass(frozen=True, kw_only=True, slots=True)
class SkippedView:
    """A view whose scene is missing."""

    view: int
    why: str


@dataclass(frozen=True, kw_only=True, slots=True)
class SetFigures:
    """Figures in the record of a finished set."""

    frames: int
    bytes: int
    skipped: tuple[SkippedView, ...]


@dataclass(frozen=True, kw_only=True, slots=True)
class SetRun:
    """Arguments that determine a set, besides the plan."""

    folder: str  # Folder at which the plan's relative paths start.
    layout: Layout
    shard_frames: int
    variant: str  # Variant of Mitsuba.


@dataclass(frozen=True, kw_only=True, slots=True)
class SetOrigin:
    """Content of `plan.toml`: everything that determines a set."""

    plan: dict  # type: ignore[type-arg]  # Table for `plan.from_table`.
    run: SetRun
    files: dict = field(default_factory=dict)  # type: ignore[type-arg]  # SHA-256 by path.


class SetFolder:
    """Writes the results of workers, task by task, in any order."""

    def __init__(self, path: Path, layout: Layout) -> None:
        """Use a folder that `opened` has prepared."""
        self.path, self._layout = path, layout

    def done(self, tasks: Sequence[Task], frames: int) -> set[int]:
        """Return the numbers of the complete tasks.

        Args:
            tasks: all tasks of the plan.
            frames: frames of each view.

        Raises:
            InputError: if the part of a task is damaged or of another task, or its file is missing.
        """
        names = {f"{task.number:06d}.json": task for task in tasks}
        parts = self._parts()
        for part in parts:
            self._check_part(part, names.get(part.name), frames)
        return {names[part.name].number for part in parts}

    def _check_part(self, path: Path, task: Task | None, frames: int) -> None:
        """Refuse a part that does not describe its task's frames, each with its files."""
        part = _read_part(path)
        rows = [(row["view"], row["repeat"], row["frame"]) for row in part["rows"]]
        skipped = {view["view"] for view in part["skipped"]}
        rendered = [view for view in (task.views if task else ()) if view not in skipped]
        wanted = [(view, n, view * frames + n) for view in rendered for n in range(frames)]
        if task is None or not skipped <= set(task.views) or sorted(rows) != wanted:
            raise _damaged(path, "it describes another task")
        listed = {row["shard"] or name for row in part["rows"] for name in row["files"]}
        for name in sorted(listed):
            if not (self.path / name).is_file():
                raise _damaged(path, f"{name} is missing")

    def _parts(self) -> list[Path]:
        folder = self.path / _PARTS
        return sorted(part for part in folder.glob("*.json") if part.stem.isdecimal())

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
                    self._place(view)
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
        with output.refused(self.path):
            _remove_partial(self.path)  # Left by workers that failed or were killed.
        results = [_read_part(part) for part in self._parts()]
        frames = [row for result in results for row in result["rows"]]
        skipped = [view for result in results for view in result["skipped"]]
        figures = {
            "frames": len(frames),
            "bytes": sum(row["bytes"] for row in frames),
            "skipped": skipped,
        }
        text = record.dumps({**summary, "versions": record.versions(), "figures": figures})
        contents = {index.FILE: index.encode(frames), output.RECORD: text.encode()}
        self._write(index.FILE, contents[index.FILE])
        for name in (capture_info.FILE, PLAN):
            contents[name] = (self.path / name).read_bytes()
        lines = [f"{sha256(contents[name]).hexdigest()}  {name}\n" for name in sorted(OWN_FILES)]
        self._write(CHECKSUMS, "".join(lines).encode())
        self._write(output.RECORD, contents[output.RECORD])  # It marks the set as finished.
        with output.refused(self.path):
            shutil.rmtree(self.path / _PARTS)

    @property
    def finished(self) -> bool:
        """Whether the index and the record exist."""
        return (self.path / output.RECORD).is_file()

    def _write(self, name: str, data: bytes) -> None:
        output.write_file(self.path / name, data, force=True)

    def _place(self, view: RenderedView) -> None:
        """Move a view's folder to its place, after writing it if its files are in memory."""
        part = view.staged
        if part is None:
            part = self.path / f".{view.name}.partial"
            shutil.rmtree(part, ignore_errors=True)
            write_files(part, view.name, view.files)
        shutil.rmtree(self.path / view.name, ignore_errors=True)  # Left by an incomplete task.
        part.rename(self.path / view.name)


def _read_part(path: Path) -> dict[str, Any]:
    """Read the rows and skipped views of a complete task.

    Raises:
        InputError: if the file is damaged.
    """
    try:
        part = files.parse_json(files.read_bytes(path), path)
        if not isinstance(part, dict) or set(part) != {"rows", "skipped"}:
            raise errors.refuse(path.name, "must hold rows and skipped", repr(part)[:80], "")
        part["rows"] = [index.check_row(row, path) for row in part["rows"]]
        for view in part["skipped"]:
            structure.from_table(SkippedView, view)
    except (errors.InputError, TypeError, AttributeError) as error:
        raise _damaged(path, str(error)) from None
    return part


def _damaged(path: Path, defect: str) -> errors.InputError:
    advice = "Delete it: its task is then repeated."
    return errors.refuse("part of the set", "must be whole", f"{path}: {defect}", advice)


def figures(path: Path) -> SetFigures:
    """Return the frames, bytes and skipped views of a finished set.

    Raises:
        InputError: if the record is missing or damaged.
    """
    file = path / output.RECORD
    try:
        content = files.parse_json(files.read_bytes(file), file)
        if not isinstance(content, dict) or "figures" not in content:
            raise errors.refuse(output.RECORD, "must have figures", repr(content)[:80], "")
        return structure.from_table(SetFigures, content["figures"], "figures")
    except errors.InputError as error:
        rule, advice = f"must have its {output.RECORD}", "Is it a finished set of generate?"
        raise errors.refuse("set", rule, f"{path}: {error}", advice) from error


def origin(path: Path) -> SetOrigin:
    """Read the set's `plan.toml`.

    Raises:
        InputError: if the file is missing or damaged.
    """
    try:
        return files.read_toml(path / PLAN, lambda table: structure.from_table(SetOrigin, table))
    except errors.InputError as error:
        advice = "Copy it again, or verify the original."
        raise errors.refuse("set", f"must have its {PLAN}", f"{path}: {error}", advice) from error


def checksums(path: Path) -> dict[str, str]:
    """Read the SHA-256 of the set's own files by name, in hexadecimal digits.

    Raises:
        InputError: if the file is missing or damaged.
    """
    lines = files.read_text(path / CHECKSUMS).splitlines()
    words = [line.split("  ", 1) for line in lines]
    if not words or not all(len(pair) == 2 and _HEX.fullmatch(pair[0]) for pair in words):
        raise errors.refuse(CHECKSUMS, "must list checksums", path, "Copy it again.")
    return {name: digest for digest, name in words}


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
    begun = plan_file.is_file() and ((path / _PARTS).is_dir() or (path / output.RECORD).is_file())
    if begun:  # Before anything is written.
        _refuse_other(files.read_text(plan_file), plan, path)
    if path.exists() and not begun and (not path.is_dir() or _others(path)):
        advice = "Choose another folder, or empty this one yourself."
        raise errors.refuse("out", "must be a new folder or an unfinished set", path, advice)
    with output.refused(path):
        (path / _PARTS).mkdir(parents=True, exist_ok=True)
    with lock.exclusive(path):
        with output.refused(path):
            if (path / output.RECORD).is_file():
                shutil.rmtree(path / _PARTS)
            _remove_partial(path)
        if not begun:
            output.write_file(plan_file, plan.encode())
        yield SetFolder(path, layout)


def _remove_partial(path: Path) -> None:
    """Remove what an earlier run began to write."""
    for partial in [*path.glob(".*.partial"), *(path / _PARTS).glob(".*.partial")]:
        shutil.rmtree(partial) if partial.is_dir() else partial.unlink()


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
    raise errors.refuse(
        "plan", f"must be that of {path}", "; ".join(changed) or "other line ends", advice
    )
