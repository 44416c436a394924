"""Frames whose truth is known, as training asks for them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from starling.learning.completion.frame import Frame, Image


@dataclass(frozen=True, slots=True, eq=False)
class Sample:
    """A frame and what should come out."""

    frame: Frame
    truth_m: Image  # (h, w) z [m], NaN where not known.


class Samples(Protocol):
    """What training draws from; each is asked for when it is drawn, so it may lie on a disk."""

    @property
    def identity(self) -> str:
        """Text that changes when a sample does."""
        ...

    def __len__(self) -> int:
        """How many."""
        ...

    def __getitem__(self, number: int) -> Sample:
        """One of them, the same each time."""
        ...
