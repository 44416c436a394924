"""Is a multi-part, ZIP-compressed scan-line OpenEXR file whole?

The OpenEXR library reports a cut or damaged file only in part: it prints, leaves the part out and
goes on, and when a disk fills while writing it may say nothing at all. This walks the file.
Layout: https://openexr.com/en/latest/OpenEXRFileLayout.html
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass

_MAGIC = b"\x76\x2f\x31\x01"
_MULTIPART = 1 << 12
_ZIP = 3
_LINES = 16  # Scan lines in a chunk of ZIP compression.
_BYTES = {0: 4, 1: 2, 2: 4}  # Of the pixel types uint, half, float.
_WIDEST = 16384


class DamagedError(Exception):
    """The file is not whole; the message says in what."""


@dataclass(frozen=True, kw_only=True, slots=True)
class _Part:
    width: int
    height: int
    top: int
    bytes_per_pixel: int

    @property
    def chunks(self) -> int:
        return -(-self.height // _LINES)


def check(data: bytes, *, pixels: bool = True) -> None:
    """Walk a file from its headers to the last chunk.

    Args:
        data: the file.
        pixels: also unpack every chunk, which finds damage inside (about 0.2 s a frame).

    Raises:
        DamagedError: if anything is missing or does not add up.
    """
    if not data.startswith(_MAGIC):
        raise DamagedError("an empty file" if not data else "no OpenEXR file")
    try:
        if not struct.unpack_from("<I", data, 4)[0] & _MULTIPART:
            raise DamagedError("a file of a single part")
        parts, at = _headers(data)
        _chunks(data, parts, at, pixels=pixels)
    except (struct.error, ValueError, KeyError, IndexError, OverflowError) as error:
        raise DamagedError("cut short or damaged") from error
    except zlib.error as error:
        raise DamagedError("damaged pixel data") from error


def _headers(data: bytes) -> tuple[list[_Part], int]:
    """Read every part's header; the list ends with an empty one."""
    parts, at = [], 8
    while data[at] != 0:
        attributes, at = _attributes(data, at)
        parts.append(_part(attributes))
    return parts, at + 1


def _attributes(data: bytes, at: int) -> tuple[dict[str, bytes], int]:
    attributes = {}
    while data[at] != 0:
        name, at = _string(data, at)
        _, at = _string(data, at)  # The type, which the name implies.
        (size,) = struct.unpack_from("<I", data, at)
        at += 4
        attributes[name] = data[at : at + size]
        at += size
    return attributes, at + 1


def _part(attributes: dict[str, bytes]) -> _Part:
    left, top, right, bottom = struct.unpack("<4i", attributes["dataWindow"])
    width, height = right - left + 1, bottom - top + 1
    (chunks,) = struct.unpack("<i", attributes["chunkCount"])
    channels, at, size = attributes["channels"], 0, 0
    while channels[at] != 0:
        _, at = _string(channels, at)
        kind, _, x_step, y_step = struct.unpack_from("<i4sii", channels, at)
        if (x_step, y_step) != (1, 1):
            raise DamagedError("subsampled channels")
        size += _BYTES[kind]
        at += 16
    part = _Part(width=width, height=height, top=top, bytes_per_pixel=size)
    if not (0 < width <= _WIDEST and 0 < height <= _WIDEST):
        raise DamagedError(f"a size of {width}x{height}")
    if attributes["compression"] != bytes([_ZIP]) or attributes["type"] != b"scanlineimage":
        raise DamagedError("another kind than ZIP scan lines")
    if chunks != part.chunks:
        raise DamagedError("a wrong number of chunks")
    return part


def _string(data: bytes, at: int) -> tuple[str, int]:
    end = data.index(b"\0", at)
    return data[at:end].decode("ascii"), end + 1


def _chunks(data: bytes, parts: list[_Part], at: int, *, pixels: bool) -> None:
    for number, part in enumerate(parts):
        offsets = struct.unpack_from(f"<{part.chunks}Q", data, at)
        at += 8 * part.chunks
        for index, offset in enumerate(offsets):
            owner, line, packed = struct.unpack_from("<iii", data, offset)
            start = offset + 12
            if owner != number or line != part.top + index * _LINES or packed < 0:
                raise DamagedError("a chunk that is out of place")
            if start + packed > len(data):
                raise DamagedError("cut short")
            lines = min(_LINES, part.height - index * _LINES)
            size = lines * part.width * part.bytes_per_pixel
            if packed > size:
                raise DamagedError("a chunk that is too long")
            if pixels and packed < size:  # What does not shrink is stored as it is.
                _check_inflates(data[start : start + packed], size)


def _check_inflates(packed: bytes, size: int) -> None:
    if len(zlib.decompressobj().decompress(packed, size + 1)) != size:
        raise DamagedError("too little pixel data")
