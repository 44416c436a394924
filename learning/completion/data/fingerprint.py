"""A fingerprint of frames that changes with their files, computed without reading an image."""

from __future__ import annotations

import os
import zlib
from collections.abc import Sequence
from pathlib import Path

from starling.learning.completion.data.layouts import ListedFrame
from starling.patterns.errors import InputError, refuse

# The end of a PNG file contains a checksum of all pixels.
_END_BYTES = 32


def fingerprint(frames: Sequence[ListedFrame]) -> str:
    """Hash the names of frames and, for each of their files, name, size and last 32 bytes.

    This detects any change of a PNG file, independent of its folder and time. For other files it
    detects changes of size and end only. It does not detect a changed image inside one file that
    holds all images, as in NYUv2.

    Raises:
        InputError: if a file is missing; this is better than an error during training.
    """
    value = 0
    for frame in frames:
        value = zlib.crc32(frame.name.encode(), value)
        for path in frame.files:
            value = zlib.crc32(_end(frame.name, path), value)
    return f"{len(frames)} {value:08x}"


def _end(frame: str, path: Path) -> bytes:
    """Return name, size and last bytes of a file."""
    try:
        with path.open("rb") as file:
            size = file.seek(0, os.SEEK_END)
            file.seek(max(0, size - _END_BYTES))
            return f"{path.name} {size} ".encode() + file.read()
    except OSError as error:
        raise _missing(frame, path) from error


def _missing(frame: str, path: Path) -> InputError:
    advice = "Leave it out, or copy it again."
    return refuse(f"frame {frame}", f"must have {path.name} for training", "none", advice)
