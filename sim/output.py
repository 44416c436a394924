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

from patterns import errors

RECORD = (
    "starling.json"  # What every verb leaves in its folder; --force replaces only such folders.
)


class OutputFolder:
    """A folder that a verb fills and that appears under its name when the `with` block ends.

    On any exception inside the block, a keyboard interrupt included, nothing is left behind and
    what stood there before still stands.

    Example:
        >>> with OutputFolder(Path("out")) as folder:  # doctest: +SKIP
        ...     folder.write("table/0/depth.png", png_bytes)
    """

    def __init__(self, path: Path | str, *, force: bool = False) -> None:
        self.path = Path(os.path.abspath(path))
        self._force = force
        self._partial = self.path.with_name(f".{self.path.name}.{uuid.uuid4().hex[:8]}.partial")
        self._made_parents: list[Path] = []

    def __enter__(self) -> OutputFolder:
        """Refuse what cannot be written, before any work is done.

        Raises:
            InputError: if the folder holds something and may not be replaced, is a file, or
                cannot be made.
        """
        _refuse_occupied(self.path, force=self._force)
        with _refused(self.path):
            parent = self.path.parent
            self._made_parents = [p for p in (parent, *parent.parents) if not p.exists()]
            parent.mkdir(parents=True, exist_ok=True)
            self._partial.mkdir()
        return self

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
        with _refused(self.path):
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
                with _refused(self.path):
                    _replace_folder(self._partial, self.path)
        finally:
            if self._partial.exists():
                shutil.rmtree(self._partial, ignore_errors=True)
                for parent in self._made_parents:
                    with _ignored():
                        parent.rmdir()


def write_file(path: Path | str, data: bytes, *, force: bool = False) -> None:
    """Write one file whole or not at all.

    Raises:
        InputError: if it exists and `force` is not given, or cannot be written.
    """
    path = Path(os.path.abspath(path))
    if path.is_dir():
        raise errors.refuse("out", "must be a file", f"the folder {path}", "Add a file name.")
    if path.exists() and not force:
        raise errors.refuse("out", "must not exist", path, "Choose another name or give --force.")
    partial = path.with_name(f".{path.name}.{uuid.uuid4().hex[:8]}.partial")
    with _refused(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            partial.write_bytes(data)
            os.replace(partial, path)
        finally:
            partial.unlink(missing_ok=True)


def _refuse_occupied(path: Path, *, force: bool) -> None:
    if path.exists() and not path.is_dir():
        raise errors.refuse("out", "must be a folder", f"the file {path}", "Choose another name.")
    with _refused(path):
        occupied = path.is_dir() and any(path.iterdir())
    if occupied and not force:
        raise errors.refuse(
            "out", "must be an empty or new folder", path, "Choose another or give --force."
        )
    if occupied and not (path / RECORD).is_file():  # --force must never eat somebody's home.
        raise errors.refuse(
            "out",
            "must be a folder that starling wrote to be replaced",
            f"{path} without {RECORD}",
            "Choose another folder or empty this one yourself.",
        )


def _replace_folder(new: Path, path: Path) -> None:
    """Rename `new` to `path`; what stood there goes only when the new one stands."""
    old = path.with_name(f".{path.name}.{uuid.uuid4().hex[:8]}.old")
    if path.exists():
        os.rename(path, old)
    try:
        os.rename(new, path)
    except OSError:
        if old.exists():
            os.rename(old, path)
        raise
    shutil.rmtree(old, ignore_errors=True)


@contextmanager
def _refused(path: Path) -> Iterator[None]:
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
    """Go on when a parent cannot be removed: somebody else uses it by now."""
    try:
        yield
    except OSError:
        return
