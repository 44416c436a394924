"""A name of frames that changes when they do, found without reading an image."""

from __future__ import annotations

import os
import zlib
from collections.abc import Sequence
from pathlib import Path

from starling.learning.completion.data.layouts import Listed
from starling.patterns.errors import InputError, refuse

# A PNG ends in a check sum of all its pixels, then a check sum of that part and an empty part.
_END_BYTES = 32


def fingerprint(frames: Sequence[Listed]) -> str:
    """Hash the names of frames and, of each of their files, name, size and last 32 bytes.

    So it tells of any change to a PNG, wherever the file lies and whenever it was copied. Of other
    files it tells of those that change size or end: of one file that holds all images, as NYUv2's,
    it does not notice one image put in another's place.

    Raises:
        InputError: if a file is missing: better before training than in its midst.
    """
    value = 0
    for frame in frames:
        value = zlib.crc32(frame.name.encode(), value)
        for path in frame.files:
            value = zlib.crc32(_end(frame.name, path), value)
    return f"{len(frames)} {value:08x}"


def _end(frame: str, path: Path) -> bytes:
    """Name, size and last bytes of a file."""
    try:
        with path.open("rb") as file:
            size = file.seek(0, os.SEEK_END)
            file.seek(max(0, size - _END_BYTES))
            return f"{path.name} {size} ".encode() + file.read()
    except OSError as error:
        raise _missing(frame, path) from error


def _missing(frame: str, path: Path) -> InputError:
    advice = "Leave it out, or copy it again."
    return refuse(f"frame {frame}", f"must have {path.name} to be learnt from", "none", advice)
