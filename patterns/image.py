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
    if not content.startswith(PNG_SIGNATURE):
        raise refuse("pattern file", "must be a PNG", path, "Convert it to a grey PNG.")
    try:
        chunks = png_chunks(content)
    except ValueError as error:
        raise _damaged(path) from error
    _check_header(path, chunks)
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


def png_chunks(content: bytes) -> list[tuple[bytes, bytes]]:
    """List kind and data of a PNG's chunks up to IEND, with verified checksums.

    OpenCV silently fills the missing part of a damaged PNG with zeros.

    Args:
        content: file that starts with `PNG_SIGNATURE`.

    Raises:
        ValueError: that names the defect, if the file is cut short or a checksum is wrong.
    """
    chunks: list[tuple[bytes, bytes]] = []
    position = len(PNG_SIGNATURE)
    while not chunks or chunks[-1][0] != b"IEND":
        end = position + 12 + int.from_bytes(content[position : position + 4], "big")
        if end > len(content):
            raise ValueError("a file cut short")
        chunk = content[position + 4 : end - 4]
        if zlib.crc32(chunk).to_bytes(4, "big") != content[end - 4 : end]:
            raise ValueError("a wrong checksum")
        chunks.append((chunk[:4], chunk[4:]))
        position = end
    return chunks


def _check_header(path: Path, chunks: list[tuple[bytes, bytes]]) -> None:
    """Refuse an image that is not grey, has an unusable size, or has incomplete data."""
    kinds = dict(chunks)
    header = kinds.get(b"IHDR", b"")
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
        length = len(zlib.decompress(b"".join(data for kind, data in chunks if kind == b"IDAT")))
    except zlib.error as error:
        raise _damaged(path) from error
    # Each row has one filter byte. The decoder checks interlaced images, whose rows are split.
    if not interlaced and length != height * (1 + width * bits // 8):
        raise _damaged(path)


def _damaged(path: Path) -> InputError:
    return refuse("pattern file", "must be an intact PNG", path, "Export it again.")
