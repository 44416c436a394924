"""A file of recorded messages: an index of its messages, which are read on demand."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

_KEPT_CHUNKS = 4  # Decompressed chunks that are kept: images of one time lie in neighbours.


class LostMessageError(Exception):
    """A message is in the index, but its data are damaged."""


@dataclass(frozen=True, slots=True)
class LoggedMessage:
    """Place of one message."""

    topic: str
    kind: str  # Type of the message: `sensor_msgs/msg/Image`.
    time_ns: int  # Time at which it was recorded [ns].
    read: Callable[[], bytes]


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class MessageLog:
    """Index of a recording's messages, in the order of the file."""

    entries: Sequence[LoggedMessage]
    is_ros1: bool  # Messages are serialised as in ROS 1, else in CDR.
    damage: str = ""  # What is wrong with the file behind the last entry; empty if it is whole.

    @property
    def topics(self) -> dict[str, str]:
        """Topics with the type of their messages."""
        return {entry.topic: entry.kind for entry in self.entries}


class ChunkCache:
    """Keeps the last decompressed chunks."""

    def __init__(self, load: Callable[[int], bytes]) -> None:
        """Store the function that decompresses the chunk of a number."""
        self._load = load
        self._kept: dict[int, bytes] = {}

    def __call__(self, number: int) -> bytes:
        """Return a decompressed chunk."""
        if number not in self._kept:
            if len(self._kept) >= _KEPT_CHUNKS:
                del self._kept[next(iter(self._kept))]
            self._kept[number] = self._load(number)
        return self._kept[number]


def message_kind(name: str) -> str:
    """Return a type's name as ROS 2 writes it: `sensor_msgs/Image` has `msg` in its middle."""
    package, _, rest = name.partition("/")
    return name if rest.startswith("msg/") else f"{package}/msg/{rest}"
