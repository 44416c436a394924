"""Sequences whose items are read on each access, so that memory does not grow with their number."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Generic, TypeVar, overload

T = TypeVar("T")


class OnDemand(Sequence[T], Generic[T]):
    """Items that a function reads from their sources."""

    def __init__(self, sources: Sequence[Any], read: Callable[[Any], T]) -> None:
        """Read nothing yet.

        Args:
            sources: one of each item.
            read: returns the same item on each call.
        """
        self._sources, self._read = sources, read

    def __len__(self) -> int:
        return len(self._sources)

    @overload
    def __getitem__(self, index: int) -> T: ...
    @overload
    def __getitem__(self, index: slice) -> OnDemand[T]: ...
    def __getitem__(self, index: int | slice) -> T | OnDemand[T]:
        """Read one item; a slice reads nothing."""
        if isinstance(index, slice):
            return OnDemand(self._sources[index], self._read)
        return self._read(self._sources[index])
