"""Structure check of multi-part, ZIP-compressed scan-line OpenEXR files.

The OpenEXR library does not report all truncated or damaged files: it prints a message, omits the
part and continues. It may also miss a full disk while writing. `check` therefore walks the file.
Layout: https://openexr.com/en/latest/OpenEXRFileLayout.html
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass

_MAGIC = b"\x76\x2f\x31\x01"
_MULTIPART = 1 << 12
_ZIP = 3
_LINES = 16  # Scan lines per chunk of ZIP compression.
_BYTES = {0: 4, 1: 2, 2: 4}  # Bytes of the pixel types uint, half and float.
_WIDEST = 16384  # Largest accepted width and height [px].


class DamagedError(Exception):
    """The file is incomplete or damaged; the message names the defect."""


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
        data: content of the file.
        pixels: also decompress every chunk, which finds damaged pixels (about 0.2 s a frame).

    Raises:
        DamagedError: if data is missing or inconsistent.
    """
    if not data.startswith(_MAGIC):
        raise DamagedError("an empty file" if not data else "no OpenEXR file")
    try:
        if not struct.unpack_from("<I", data, 4)[0] & _MULTIPART:
            raise DamagedError("a file of a single part")
        parts, position = _headers(data)
        _chunks(data, parts, position, pixels=pixels)
    except (struct.error, ValueError, KeyError, IndexError, OverflowError) as error:
        raise DamagedError("cut short or damaged") from error
    except zlib.error as error:
        raise DamagedError("damaged pixel data") from error


def _headers(data: bytes) -> tuple[list[_Part], int]:
    """Read every part's header; an empty header ends the list."""
    parts, position = [], 8
    while data[position] != 0:
        attributes, position = _attributes(data, position)
        parts.append(_part(attributes))
    return parts, position + 1


def _attributes(data: bytes, position: int) -> tuple[dict[str, bytes], int]:
    attributes = {}
    while data[position] != 0:
        name, position = _string(data, position)
        _, position = _string(data, position)  # The type; the name implies it.
        (size,) = struct.unpack_from("<I", data, position)
        position += 4
        attributes[name] = data[position : position + size]
        position += size
    return attributes, position + 1


def _part(attributes: dict[str, bytes]) -> _Part:
    left, top, right, bottom = struct.unpack("<4i", attributes["dataWindow"])
    width, height = right - left + 1, bottom - top + 1
    (chunks,) = struct.unpack("<i", attributes["chunkCount"])
    channels, position, size = attributes["channels"], 0, 0
    while channels[position] != 0:
        _, position = _string(channels, position)
        kind, _, x_step, y_step = struct.unpack_from("<i4sii", channels, position)
        if (x_step, y_step) != (1, 1):
            raise DamagedError("subsampled channels")
        size += _BYTES[kind]
        position += 16
    part = _Part(width=width, height=height, top=top, bytes_per_pixel=size)
    if not (0 < width <= _WIDEST and 0 < height <= _WIDEST):
        raise DamagedError(f"a size of {width}x{height}")
    if attributes["compression"] != bytes([_ZIP]) or attributes["type"] != b"scanlineimage":
        raise DamagedError("another kind than ZIP scan lines")
    if chunks != part.chunks:
        raise DamagedError("a wrong number of chunks")
    return part


def _string(data: bytes, position: int) -> tuple[str, int]:
    end = data.index(b"\0", position)
    return data[position:end].decode("ascii"), end + 1


def _chunks(data: bytes, parts: list[_Part], position: int, *, pixels: bool) -> None:
    for number, part in enumerate(parts):
        offsets = struct.unpack_from(f"<{part.chunks}Q", data, position)
        position += 8 * part.chunks
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
            if pixels and packed < size:  # Incompressible chunks are stored uncompressed.
                _check_inflates(data[start : start + packed], size)


def _check_inflates(packed: bytes, size: int) -> None:
    if len(zlib.decompressobj().decompress(packed, size + 1)) != size:
        raise DamagedError("too little pixel data")
