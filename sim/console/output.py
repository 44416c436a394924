"""Atomic output: files and folders are written under a temporary name and then renamed."""

from __future__ import annotations

import errno
import os
import shutil
import sqlite3
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path, PurePosixPath
from types import TracebackType
from typing import Protocol

from starling.patterns import errors

RECORD = "starling.json"  # Every output folder holds it; --force replaces only such folders.


class Folder(Protocol):
    """Anything that stores files by name."""

    def write(self, name: str, data: bytes | str) -> None:
        """Store one file; text is encoded as UTF-8."""
        ...

    def write_by(self, name: str, writer: Callable[[Path], object]) -> None:
        """Store the file that `writer` writes at the path passed to it."""
        ...


class OutputFolder:
    """An output folder that appears under its final name when the `with` block ends.

    After any exception inside the block, a keyboard interrupt included, no files remain and an
    earlier folder of that name is unchanged.

    Example:
        >>> with OutputFolder(Path("out")) as folder:  # doctest: +SKIP
        ...     folder.write("table/0/depth.png", png_bytes)
    """

    def __init__(self, path: Path | str, *, force: bool = False) -> None:
        self.path = _resolved(path)
        self._force = force
        self._partial = _temporary_name(self.path, "partial")
        self._made_parents: list[Path] = []

    def __enter__(self) -> OutputFolder:
        """Create the temporary folder; refuse an unusable path before any work is done.

        Raises:
            InputError: if the folder is not empty and may not be replaced, is a file, or cannot
                be created.
        """
        _refuse_occupied(self.path, force=self._force)
        try:
            with refused(self.path):
                self._made_parents = _missing_parents(self.path)
                self.path.parent.mkdir(parents=True, exist_ok=True)
                self.path.exists()  # Fails for a name that is too long, once the parents exist.
                self._partial.mkdir()
        except BaseException:
            self._remove_traces()
            raise
        return self

    @property
    def partial(self) -> Path:
        """Temporary folder that holds the files until the `with` block ends."""
        return self._partial

    def write(self, name: str, data: bytes | str) -> None:
        """Write one file, and create its parent folders.

        Args:
            name: path inside the folder, with forward slashes.
            data: content; text is written as UTF-8.

        Raises:
            InputError: if the disk is full or the file cannot be written.
        """
        content = data.encode() if isinstance(data, str) else data
        self.write_by(name, lambda path: path.write_bytes(content))

    def write_by(self, name: str, writer: Callable[[Path], object]) -> None:
        """Call `writer` with the path of one file to write; raises as `write`."""
        _refuse_outside(name)
        path = self._partial / name
        with refused(self.path):
            path.parent.mkdir(parents=True, exist_ok=True)
            writer(path)

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Rename the folder to its final name, or remove it after an exception."""
        try:
            if kind is None:
                with refused(self.path):
                    _replace_folder(self._partial, self.path, force=self._force)
        finally:
            if self._partial.exists():
                self._remove_traces()

    def _remove_traces(self) -> None:
        shutil.rmtree(self._partial, ignore_errors=True)
        _remove_empty(self._made_parents)


def is_inside(name: str) -> bool:
    """Return whether a relative path with forward slashes stays inside its folder."""
    path = PurePosixPath(name)
    return (
        not path.is_absolute() and ".." not in path.parts and bool(path.parts) and "\0" not in name
    )


def _refuse_outside(name: str) -> None:
    """Refuse a name that leaves its folder; `names.file_name` makes a component of any text."""
    if not is_inside(name):
        advice = "Rename the room, scene or object."
        raise errors.refuse("output file", "must stay in its folder", repr(name), advice)


def write_file(path: Path | str, data: bytes, *, force: bool = False) -> None:
    """Write one file atomically.

    Raises:
        InputError: if it exists and `force` is not given, or cannot be written.
    """
    write_file_by(path, lambda partial: partial.write_bytes(data), force=force)


def write_file_by(
    path: Path | str, writer: Callable[[Path], object], *, force: bool = False
) -> None:
    """Let `writer` write one file at the path passed to it, atomically; raises as `write_file`."""
    path = _resolved(path)
    refuse_taken(path, force=force)
    partial = _temporary_name(path, "partial")
    with refused(path):
        made_parents = _missing_parents(path)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            writer(partial)
            with partial.open("rb+") as file:
                os.fsync(file.fileno())  # The data reaches the disk before the rename does.
            refuse_taken(path, force=force)  # Another process may have created it meanwhile.
            os.replace(partial, path)
        except BaseException:
            with suppress(OSError):  # It is missing, or another process uses it.
                partial.unlink()
            _remove_empty(made_parents)
            raise


def refuse_own_input(out: Path | str, source: Path | str) -> None:
    """Refuse an output path that would overwrite the verb's own input.

    Args:
        out: path to write.
        source: captures, or scene file, that the verb reads.

    Raises:
        InputError: if `out` is, contains or lies in `source`, symbolic links resolved.
    """
    place, origin = _resolved(out), Path(os.path.realpath(source))
    if place == origin or place in origin.parents or origin in place.parents:
        raise errors.refuse(
            "out", "must lie outside its input", f"{out} for {source}", "Choose another place."
        )


def _resolved(path: Path | str) -> Path:
    """Follow symbolic links, so that their target is replaced and the links stay."""
    if "\0" in str(path):
        raise errors.refuse("out", "must hold no null byte", repr(str(path)), "Rename it.")
    path = Path(os.path.realpath(path))
    if not path.name:
        raise errors.refuse("out", "must have a name", path, "Choose a place inside it.")
    return path


def _temporary_name(path: Path, suffix: str) -> Path:
    """Temporary name in the same folder; the name is cut so that it is never too long."""
    return path.with_name(f".{path.name[:32]}.{uuid.uuid4().hex[:8]}.{suffix}")


def _missing_parents(path: Path) -> list[Path]:
    """List the parent folders that do not exist, the lowest first."""
    return [parent for parent in path.parents if not parent.exists()]


def _remove_empty(folders: list[Path]) -> None:
    for folder in folders:
        with suppress(OSError):  # It is missing, or another process uses it.
            folder.rmdir()


def refuse_taken(path: Path, *, force: bool) -> None:
    """Refuse to write a file over something that may not be replaced.

    Raises:
        InputError: if it is a folder, or exists and `force` is not given.
    """
    with refused(path):
        is_folder, exists = path.is_dir(), path.exists()
    if is_folder:
        raise errors.refuse("out", "must be a file", f"the folder {path}", "Add a file name.")
    if exists and not force:
        raise errors.refuse("out", "must not exist", path, "Choose another name or give --force.")


def _refuse_occupied(path: Path, *, force: bool) -> None:
    with refused(path):
        is_file = path.exists() and not path.is_dir()
        occupied = path.is_dir() and any(path.iterdir())
        replaceable = occupied and (path / RECORD).is_file()
    if is_file:
        raise errors.refuse("out", "must be a folder", f"the file {path}", "Choose another name.")
    if occupied and not force:
        raise errors.refuse(
            "out", "must be an empty or new folder", path, "Choose another or give --force."
        )
    if occupied and not replaceable:  # --force must never delete a user's own folder.
        raise errors.refuse(
            "out",
            "must be a folder that starling wrote to be replaced",
            f"{path} without {RECORD}",
            "Choose another folder or empty this one yourself.",
        )


def _replace_folder(new: Path, path: Path, *, force: bool) -> None:
    """Rename `new` to `path`; an old folder is removed only after the rename."""
    _refuse_occupied(path, force=force)  # Another process may have created it meanwhile.
    if not (force and path.exists()):
        os.rename(new, path)  # Replaces an empty folder, and fails on any other.
        return
    old = _temporary_name(path, "old")
    os.rename(path, old)
    try:
        os.rename(new, path)
    except BaseException:  # A termination between the renames must not lose the old folder.
        if not path.exists():
            os.rename(old, path)
        raise
    shutil.rmtree(old, ignore_errors=True)


@contextmanager
def refused(path: Path) -> Iterator[None]:
    """Turn write errors of the operating system and of SQLite (ROS 2 bags) into `InputError`."""
    try:
        yield
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            raise _disk_full(path) from error
        raise errors.refuse(
            "out", "must be writable", path, f"{error.strerror or error}: choose another place."
        ) from error
    except sqlite3.Error as error:
        if getattr(error, "sqlite_errorname", "") == "SQLITE_FULL":
            raise _disk_full(path) from error
        raise errors.refuse("out", "must be writable", path, f"SQLite: {error}.") from error
    except UnicodeEncodeError as error:
        value = os.fsencode(path)
        raise errors.refuse("out", "must be a UTF-8 path", value, "Rename the folder.") from error


def _disk_full(path: Path) -> errors.InputError:
    value = f"{path}, disk full"
    return errors.refuse("out", "must have room on its disk", value, "Free some space.")
