"""MCAP files, read from front to back so that truncated ones give what is whole.

Source: mcap.dev/spec, version 0: opcode (1 byte), length (8 bytes), content.
"""

from __future__ import annotations

import mmap
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from starling.patterns import errors
from starling.sim.captures.recordings.logs.message_log import (
    ChunkCache,
    LoggedMessage,
    MessageLog,
    message_kind,
)

MAGIC = b"\x89MCAP0\r\n"
_FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK = 2, 3, 4, 5, 6  # Opcodes.
_ENCODINGS = {"cdr": False, "ros1": True}


@dataclass(slots=True)
class _Index:
    """What the records so far have stated."""

    path: Path
    schemas: dict[int, str] = field(default_factory=dict)
    channels: dict[int, tuple[str, str]] = field(default_factory=dict)
    encodings: set[str] = field(default_factory=set)
    entries: list[LoggedMessage] = field(default_factory=list)


def open_log(path: Path) -> MessageLog:
    """Index an MCAP file.

    Raises:
        InputError: if the file is no MCAP file, or its messages are serialised otherwise than by
            ROS.
    """
    with path.open("rb") as file:
        if file.read(len(MAGIC)) != MAGIC:
            raise errors.refuse("source", "must be an MCAP file", path, "Is it one?")
        data = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    chunks: list[tuple[int, int, str]] = []
    cache = ChunkCache(lambda number: _unpacked(data, *chunks[number]))
    index, damage, whole = _Index(path), "", False
    try:
        for code, start, stop in _records(data, len(MAGIC)):
            if code == _FOOTER:
                whole = True
                break
            if stop > len(data):
                break
            if code == _CHUNK:
                compression, place = _text(data, start + 28)
                chunks.append((place + 8, stop, compression))
                _add(cache, len(chunks) - 1, index)
            else:
                _note(data, code, start, stop, partial(data.__getitem__, slice(start, stop)), index)
    except (struct.error, OSError, EOFError, RuntimeError, ValueError, KeyError) as error:
        if isinstance(error, errors.InputError):
            raise
    if not whole:
        damage = f"it breaks off after {len(index.entries)} messages"
    is_ros1 = index.encodings == {"ros1"}
    return MessageLog(entries=index.entries, is_ros1=is_ros1, damage=damage)


def _add(cache: ChunkCache, number: int, index: _Index) -> None:
    content = cache(number)
    for code, start, stop in _records(content, 0):
        if stop <= len(content):
            _note(content, code, start, stop, partial(_part, cache, number, start, stop), index)


def _part(cache: ChunkCache, number: int, start: int, stop: int) -> bytes:
    return cache(number)[start:stop]


def _note(content: Any, code: int, start: int, stop: int, read: Any, index: _Index) -> None:
    """Note a schema, channel or message."""
    if code == _SCHEMA:
        index.schemas[_number("<H", content, start)] = _text(content, start + 2)[0]
    elif code == _CHANNEL:
        topic, place = _text(content, start + 4)
        encoding, _ = _text(content, place)
        if encoding not in _ENCODINGS:
            rule = "must hold messages of ROS"
            got = f"{topic} in {encoding or 'no encoding'}"
            raise errors.refuse(index.path.name, rule, got, "Record it with ros2 bag.")
        index.encodings.add(encoding)
        kind = index.schemas.get(_number("<H", content, start + 2), "")
        index.channels[_number("<H", content, start)] = (topic, message_kind(kind))
    elif code == _MESSAGE:
        topic, kind = index.channels[_number("<H", content, start)]
        time_ns = _number("<Q", content, start + 6)
        index.entries.append(LoggedMessage(topic, kind, time_ns, partial(_data, read)))


def _data(read: Any) -> bytes:
    """Return a message's data, which follow 22 bytes of channel, number and times."""
    return read()[22:]


def _records(content: Any, place: int) -> Iterator[tuple[int, int, int]]:
    """Yield opcode, start and stop of each record; the last may end beyond the content."""
    while place + 9 <= len(content):
        code, length = struct.unpack_from("<BQ", content, place)
        yield code, place + 9, place + 9 + length
        place += 9 + length


def _number(form: str, content: Any, place: int) -> int:
    return int(struct.unpack_from(form, content, place)[0])


def _text(content: Any, place: int) -> tuple[str, int]:
    """Return a text and the place behind it."""
    stop = place + 4 + _number("<I", content, place)
    return bytes(content[place + 4 : stop]).decode(), stop


def _unpacked(data: mmap.mmap, start: int, stop: int, compression: str) -> bytes:
    content = data[start:stop]
    if compression == "lz4":
        from lz4 import frame

        return frame.decompress(content)
    return unzstd(content) if compression == "zstd" else content


def unzstd(content: bytes) -> bytes:
    """Decompress Zstandard, by the library of `rosbags`."""
    from backports import zstd

    return zstd.decompress(content)
