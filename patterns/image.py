"""Loading of a pattern from an image file."""

from __future__ import annotations

import zlib
from pathlib import Path

import numpy as np

from starling.patterns.errors import InputError, refuse
from starling.patterns.field import LARGEST_SIDE_PX, SMALLEST_SIDE_PX
from starling.patterns.pattern import Pattern

PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"


def load(path: str | Path, *, fov_x_deg: float, fov_y_deg: float) -> Pattern:
    """Load a pattern from a grey PNG of 8 or 16 bits whose values are linear irradiance.

    The image covers the tangent plane (see `Pattern`); pixels need not be square. The values are
    scaled to mean 1.

    Args:
        path: The PNG file.
        fov_x_deg: Full horizontal field of view [deg] that the image spans.
        fov_y_deg: Full vertical field of view [deg].

    Raises:
        InputError: if the file is missing, damaged, all zero, or not a grey PNG with sides of 32
            to 8192 px. Also if a field of view is out of range.
    """
    path = Path(path)
    try:
        content = path.read_bytes()
    except OSError as error:
        value = f"{path} ({error.strerror})"
        raise refuse("pattern file", "must be readable", value, "Check the path.") from error
    _check_header(path, *_chunks(path, content))
    import cv2  # Heavy, and needed here only.

    image = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
    if image is None:
        raise _damaged(path)
    if not image.any():
        value = f"{path}, all zero"
        raise refuse("pattern file", "must hold some light", value, "Give another image.")
    return Pattern.from_image(
        image, fov_x_deg=fov_x_deg, fov_y_deg=fov_y_deg, name=f"image {path.name}"
    )


def _chunks(path: Path, content: bytes) -> tuple[bytes, bytes, set[bytes]]:
    """Read header, image data and chunk names of a PNG and verify all checksums.

    OpenCV silently fills the missing part of a damaged PNG with zeros.
    """
    if not content.startswith(PNG_SIGNATURE):
        raise refuse("pattern file", "must be a PNG", path, "Convert it to a grey PNG.")
    header, data, kinds = b"", [], set()
    position = len(PNG_SIGNATURE)
    while b"IEND" not in kinds:
        end = position + 12 + int.from_bytes(content[position : position + 4], "big")
        chunk = content[position + 4 : end - 4]
        if len(content) < end or zlib.crc32(chunk).to_bytes(4, "big") != content[end - 4 : end]:
            raise _damaged(path)
        kinds.add(chunk[:4])
        if chunk[:4] == b"IHDR":
            header = chunk[4:]
        elif chunk[:4] == b"IDAT":
            data.append(chunk[4:])
        position = end
    return header, b"".join(data), kinds


def _check_header(path: Path, header: bytes, data: bytes, kinds: set[bytes]) -> None:
    """Refuse an image that is not grey, has an unusable size, or has incomplete data."""
    if len(header) != 13:
        raise _damaged(path)
    width, height = int.from_bytes(header[:4], "big"), int.from_bytes(header[4:8], "big")
    bits, colour, interlaced = header[8], header[9], header[12]
    if colour != 0 or bits not in (8, 16) or b"tRNS" in kinds:
        raise refuse(
            "pattern file",
            "must be grey with 8 or 16 bits, no alpha",
            f"{path} (PNG colour type {colour}, {bits} bits)",
            "Convert it to one grey channel.",
        )
    if min(width, height) < SMALLEST_SIDE_PX or max(width, height) > LARGEST_SIDE_PX:
        raise refuse(
            "pattern file",
            f"must have sides of {SMALLEST_SIDE_PX} to {LARGEST_SIDE_PX} px",
            f"{path} {width}x{height}",
            "Give the pattern at the projector's resolution.",
        )
    try:
        length = len(zlib.decompress(data))
    except zlib.error as error:
        raise _damaged(path) from error
    # Each row has one filter byte. The decoder checks interlaced images, whose rows are split.
    if not interlaced and length != height * (1 + width * bits // 8):
        raise _damaged(path)


def _damaged(path: Path) -> InputError:
    return refuse("pattern file", "must be an intact PNG", path, "Export it again.")
