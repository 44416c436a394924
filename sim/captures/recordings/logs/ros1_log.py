"""ROS 1 bags (version 2.0), read from front to back so that truncated ones give what is whole.

A bag is a list of records: header length, header fields `name=value`, data length, data. Chunks
hold connections and messages, compressed by bz2 or lz4.

Source: wiki.ros.org/Bags/Format/2.0.
"""

from __future__ import annotations

import bz2
import mmap
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from starling.patterns import errors
from starling.sim.captures.recordings.logs.message_log import (
    ChunkCache,
    LoggedMessage,
    MessageLog,
    message_kind,
)

MAGIC = b"#ROSBAG V2.0\n"
_MESSAGE, _CHUNK, _CONNECTION = 2, 5, 7  # Values of the field `op`.
_LENGTH = struct.Struct("<I")
_TIME = struct.Struct("<II")


@dataclass(frozen=True, slots=True)
class _Record:
    fields: dict[bytes, bytes]
    start: int  # Of the data.
    stop: int  # Beyond the buffer's end if the record is cut.


class _CutError(Exception):
    """The buffer ends inside a record's header, or holds no record."""


def open_log(path: Path) -> MessageLog:
    """Index a bag.

    Raises:
        InputError: if the file is no bag of version 2.0.
    """
    with path.open("rb") as file:
        if file.read(len(MAGIC)) != MAGIC:
            raise errors.refuse("source", "must be a ROS 1 bag of version 2.0", path, "Is it one?")
        data = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    chunks: list[tuple[int, int, bytes]] = []
    cache = ChunkCache(lambda number: _unpacked(data, *chunks[number]))
    kinds: dict[int, tuple[str, str]] = {}
    entries: list[LoggedMessage] = []
    damage = ""
    try:
        for record in _records(data, len(MAGIC)):
            op = record.fields[b"op"][0]
            if op == _CHUNK:
                chunks.append((record.start, record.stop, record.fields[b"compression"]))
                _index(len(chunks) - 1, cache, kinds, entries)
            elif op == _CONNECTION:
                _connect(record, data, kinds)
            if record.stop > len(data):
                raise _CutError
    except (
        _CutError,
        struct.error,
        OSError,
        EOFError,
        RuntimeError,
        ValueError,
        KeyError,
        IndexError,
    ):
        damage = f"it breaks off after {len(entries)} messages"
    return MessageLog(entries=entries, is_ros1=True, damage=damage)


def _index(
    number: int, cache: ChunkCache, kinds: dict[int, tuple[str, str]], entries: list[LoggedMessage]
) -> None:
    """Add the messages of one chunk."""
    content = cache(number)
    for record in _records(content, 0):
        op = record.fields[b"op"][0]
        if op == _CONNECTION:
            _connect(record, content, kinds)
        elif op == _MESSAGE and record.stop <= len(content):
            topic, kind = kinds[_LENGTH.unpack(record.fields[b"conn"])[0]]
            seconds, rest = _TIME.unpack(record.fields[b"time"])
            read = partial(_message, cache, number, record.start, record.stop)
            entries.append(LoggedMessage(topic, kind, seconds * 10**9 + rest, read))


def _message(cache: ChunkCache, number: int, start: int, stop: int) -> bytes:
    return cache(number)[start:stop]


def _connect(
    record: _Record, content: bytes | mmap.mmap, kinds: dict[int, tuple[str, str]]
) -> None:
    """Note topic and type of a connection; its data are fields too."""
    described = _fields(content[record.start : record.stop])
    number = _LENGTH.unpack(record.fields[b"conn"])[0]
    kinds[number] = (record.fields[b"topic"].decode(), message_kind(described[b"type"].decode()))


def _records(content: bytes | mmap.mmap, place: int) -> Iterator[_Record]:
    """Yield records; the last may end beyond the content."""
    while place < len(content):
        length = _length(content, place)
        fields = _fields(content[place + 4 : place + 4 + length])
        start = place + 8 + length
        stop = start + _length(content, start - 4)
        if b"op" not in fields:
            raise _CutError
        yield _Record(fields, start, stop)
        place = stop


def _length(content: bytes | mmap.mmap, place: int) -> int:
    if place + 4 > len(content):
        raise _CutError
    return int(_LENGTH.unpack_from(content, place)[0])


def _fields(header: bytes) -> dict[bytes, bytes]:
    fields, place = {}, 0
    while place < len(header):
        length = _length(header, place)
        name, _, value = header[place + 4 : place + 4 + length].partition(b"=")
        fields[name] = value
        place += 4 + length
    return fields


def _unpacked(data: mmap.mmap, start: int, stop: int, compression: bytes) -> bytes:
    content = data[start:stop]
    if compression == b"bz2":
        return bz2.decompress(content)
    if compression == b"lz4":
        from lz4 import frame

        return frame.decompress(content)
    return content
