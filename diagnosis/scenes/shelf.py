"""Attributes whose values move to temporary files, so that memory does not grow with their owners.

A process holds the values of the owners that it used last. It writes those of others to files, and
reads them again at their next use.
"""

from __future__ import annotations

import pickle
import tempfile
import weakref
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Generic, TypeVar, overload

T = TypeVar("T")

MOST_HELD = 4  # Owners whose values stay in memory: a scene takes about 700 bytes a pixel.


class Shelved(Generic[T]):
    """Attribute that is in memory, or in a file after `MOST_HELD` other owners were used.

    A value that cannot be pickled stays in memory: loaded Mitsuba shapes are such values.
    """

    def __init__(self, *, changes: bool = False) -> None:
        """Describe the attribute.

        Args:
            changes: whether the value changes in place, so that each move writes it again.
        """
        self.changes = changes
        self._name = ""

    def __set_name__(self, owner: type, name: str) -> None:
        """Take the name of the attribute."""
        self._name = name

    @overload
    def __get__(self, owner: None, kind: type) -> Shelved[T]: ...
    @overload
    def __get__(self, owner: object, kind: type) -> T: ...
    def __get__(self, owner: object | None, kind: type) -> Any:
        """Return the value; read it if it is in a file."""
        if owner is None:  # A dataclass then takes the attribute as a field without default.
            raise AttributeError(self._name)
        values = _shelf.use(owner)
        if self._name not in values.held:
            with values.files[self._name].open("rb") as file:
                values.held[self._name] = pickle.load(file)
        return values.held[self._name]

    def __set__(self, owner: object, value: T) -> None:
        """Replace the value."""
        values = _shelf.use(owner)
        values.held[self._name] = value
        values.discard(self._name)
        values.changing |= {self._name} if self.changes else set()


@dataclass(slots=True, weakref_slot=True, eq=False)
class _Values:
    """Shelved values of one owner, by attribute."""

    held: dict[str, Any] = field(default_factory=dict)  # In memory.
    files: dict[str, Path] = field(default_factory=dict)  # Also or only in files.
    changing: set[str] = field(default_factory=set)  # Attributes that change in place.

    def discard(self, name: str) -> None:
        """Remove the file of a value, if there is one."""
        if name in self.files:
            self.files.pop(name).unlink(missing_ok=True)


class _Shelf:
    """The shelved values of a process."""

    def __init__(self) -> None:
        self._values: weakref.WeakKeyDictionary[object, _Values] = weakref.WeakKeyDictionary()
        self._recent: list[weakref.ref[_Values]] = []  # With values in memory; last used last.
        self._written = 0  # Number of files written so far.
        self.folder: Path | None = None  # Of the files; None: a temporary one of this process.

    @cached_property
    def _own_folder(self) -> tempfile.TemporaryDirectory[str]:
        return temporary_folder()

    def use(self, owner: object) -> _Values:
        """Return the values of an owner, and move those of the owner used longest ago."""
        values = self._values.get(owner)
        if values is None:
            values = self._values[owner] = _Values()
            weakref.finalize(owner, _remove, values.files).atexit = False
        if self._recent and self._recent[-1]() is values:
            return values
        recent = (each() for each in self._recent)
        alive = [each for each in recent if each is not None and each is not values]
        first = max(len(alive) + 1 - MOST_HELD, 0)
        for oldest in alive[:first]:
            self._move(oldest)
        self._recent = [weakref.ref(each) for each in (*alive[first:], values)]
        return values

    def _move(self, values: _Values) -> None:
        """Move values from memory to files."""
        for name, value in list(values.held.items()):
            if name in values.changing or name not in values.files:
                folder = self.folder or Path(self._own_folder.name)
                path = values.files.get(name) or folder / str(self._written)
                values.files[name] = path
                self._written += 1
                try:
                    with path.open("wb") as file:
                        pickle.dump(value, file, pickle.HIGHEST_PROTOCOL)
                except (TypeError, pickle.PicklingError):
                    values.discard(name)
                    continue
            del values.held[name]


def _remove(files: dict[str, Path]) -> None:
    """Remove the files of an owner that is no longer used."""
    for path in files.values():
        path.unlink(missing_ok=True)


_shelf = _Shelf()


def temporary_folder() -> tempfile.TemporaryDirectory[str]:
    """Make a folder for files of shelved values."""
    return tempfile.TemporaryDirectory(prefix="starling-", ignore_cleanup_errors=True)


def use_folder(folder: Path) -> None:
    """Write the files of this process to a folder that another process removes."""
    _shelf.folder = folder


@dataclass(eq=False, repr=False)
class _Box(Generic[T]):
    """Owner of one value."""

    value: Shelved[T] = Shelved()


class Derived(Sequence[T]):
    """Sequence whose items are computed at each use, so that they take no memory."""

    def __init__(self, count: int, item: Callable[[int], T]) -> None:
        """Describe the sequence.

        Args:
            count: number of items.
            item: computes the item of an index, from 0.
        """
        self._range, self._item = range(count), item

    def __len__(self) -> int:
        """Return the number of items."""
        return len(self._range)

    @overload
    def __getitem__(self, index: int) -> T: ...
    @overload
    def __getitem__(self, index: slice) -> Sequence[T]: ...
    def __getitem__(self, index: int | slice) -> T | Sequence[T]:
        """Compute one item, or describe some."""
        if isinstance(index, slice):
            chosen = self._range[index]
            return Derived(len(chosen), lambda number: self._item(chosen[number]))
        return self._item(self._range[index])


def select(items: Sequence[T], numbers: Sequence[int]) -> Sequence[T]:
    """Select items by their numbers; each is read at its use."""
    return Derived(len(numbers), lambda number: items[numbers[number]])


def shelve(values: Iterable[T]) -> Sequence[T]:
    """Move values to files; each is read at its use."""
    boxes = [_Box(value) for value in values]
    return Derived(len(boxes), lambda number: boxes[number].value)
