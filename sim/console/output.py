"""Output that appears whole or not at all: written under a temporary name, then renamed."""

from __future__ import annotations

import errno
import os
import shutil
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Protocol

from starling.patterns import errors

RECORD = (
    "starling.json"  # What every verb leaves in its folder; --force replaces only such folders.
)


class Folder(Protocol):
    """What takes files by name."""

    def write(self, name: str, data: bytes | str) -> None:
        """Take one file; text is UTF-8."""
        ...

    def write_by(self, name: str, writer: Callable[[Path], object]) -> None:
        """Take what `writer` writes at the path it is given."""
        ...


class OutputFolder:
    """A folder that a verb fills and that appears under its name when the `with` block ends.

    On any exception inside the block, a keyboard interrupt included, nothing is left behind and
    what stood there before still stands.

    Example:
        >>> with OutputFolder(Path("out")) as folder:  # doctest: +SKIP
        ...     folder.write("table/0/depth.png", png_bytes)
    """

    def __init__(self, path: Path | str, *, force: bool = False) -> None:
        self.path = _resolved(path)
        self._force = force
        self._partial = _hidden_beside(self.path, "partial")
        self._made_parents: list[Path] = []

    def __enter__(self) -> OutputFolder:
        """Refuse what cannot be written, before any work is done.

        Raises:
            InputError: if the folder holds something and may not be replaced, is a file, or
                cannot be made.
        """
        _refuse_occupied(self.path, force=self._force)
        try:
            with refused(self.path):
                self._made_parents = _missing_parents(self.path)
                self.path.parent.mkdir(parents=True, exist_ok=True)
                self.path.exists()  # A name that is too long shows only now that parents exist.
                self._partial.mkdir()
        except BaseException:
            self._remove_traces()
            raise
        return self

    @property
    def partial(self) -> Path:
        """Where the folder's files stand until the `with` block ends."""
        return self._partial

    def write(self, name: str, data: bytes | str) -> None:
        """Write one file, making the folders on its way.

        Args:
            name: path inside the folder, with forward slashes.
            data: content; text is written as UTF-8.

        Raises:
            InputError: if the disk is full or the file cannot be written.
        """
        content = data.encode() if isinstance(data, str) else data
        self.write_by(name, lambda path: path.write_bytes(content))

    def write_by(self, name: str, writer: Callable[[Path], object]) -> None:
        """Let `writer` write one file at the path it is given; refuses as `write` does."""
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
        """Put the folder in its place, or remove every trace of it after an exception."""
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


def write_file(path: Path | str, data: bytes, *, force: bool = False) -> None:
    """Write one file whole or not at all.

    Raises:
        InputError: if it exists and `force` is not given, or cannot be written.
    """
    path = _resolved(path)
    refuse_taken(path, force=force)
    partial = _hidden_beside(path, "partial")
    with refused(path):
        made_parents = _missing_parents(path)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            partial.write_bytes(data)
            with partial.open("rb+") as file:
                os.fsync(file.fileno())  # On the disk before it has its name.
            refuse_taken(path, force=force)  # Somebody may have come first.
            os.replace(partial, path)
        except BaseException:
            with _ignored():
                partial.unlink()
            _remove_empty(made_parents)
            raise


def refuse_own_input(out: Path | str, source: Path | str) -> None:
    """Refuse a place whose replacing would destroy what it is made from.

    Args:
        out: where a verb will write.
        source: the captures, or the scene file, that the verb reads.

    Raises:
        InputError: if `out` is, contains or lies in `source`, symbolic links resolved.
    """
    place, origin = _resolved(out), Path(os.path.realpath(source))
    if place == origin or place in origin.parents or origin in place.parents:
        raise errors.refuse(
            "out",
            "must lie apart from what it is made from",
            f"{out} for {source}",
            "Choose another place.",
        )


def _resolved(path: Path | str) -> Path:
    """Follow symbolic links, so that what they point to is replaced and not they."""
    path = Path(os.path.realpath(path))
    if not path.name:
        raise errors.refuse("out", "must have a name", path, "Choose a place inside it.")
    return path


def _hidden_beside(path: Path, suffix: str) -> Path:
    """Name something for a while; part of the name is enough, and never too long."""
    return path.with_name(f".{path.name[:32]}.{uuid.uuid4().hex[:8]}.{suffix}")


def _missing_parents(path: Path) -> list[Path]:
    """List the folders above that would have to be made, the lowest first."""
    return [parent for parent in path.parents if not parent.exists()]


def _remove_empty(folders: list[Path]) -> None:
    for folder in folders:
        with _ignored():
            folder.rmdir()


def refuse_taken(path: Path, *, force: bool) -> None:
    """Refuse to write a file where something stands that may not be replaced.

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
    if occupied and not replaceable:  # --force must never eat somebody's home.
        raise errors.refuse(
            "out",
            "must be a folder that starling wrote to be replaced",
            f"{path} without {RECORD}",
            "Choose another folder or empty this one yourself.",
        )


def _replace_folder(new: Path, path: Path, *, force: bool) -> None:
    """Rename `new` to `path`; what stood there goes only when the new one stands."""
    _refuse_occupied(path, force=force)  # Somebody may have come first.
    if not (force and path.exists()):
        os.rename(new, path)  # Takes an empty folder's place, and fails on any other.
        return
    old = _hidden_beside(path, "old")
    os.rename(path, old)
    try:
        os.rename(new, path)
    except BaseException:  # A termination in between must not lose what stood there either.
        if not path.exists():
            os.rename(old, path)
        raise
    shutil.rmtree(old, ignore_errors=True)


@contextmanager
def refused(path: Path) -> Iterator[None]:
    """Turn what the operating system says while writing into a refusal."""
    try:
        yield
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            raise errors.refuse(
                "out", "must have room on its disk", f"{path}, disk full", "Free some space."
            ) from error
        raise errors.refuse(
            "out", "must be writable", path, f"{error.strerror or error}: choose another place."
        ) from error


@contextmanager
def _ignored() -> Iterator[None]:
    """Go on when something cannot be removed: it is not there, or somebody else uses it."""
    try:
        yield
    except OSError:
        return
