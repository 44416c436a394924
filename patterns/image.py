"""Loading of a pattern from an image file."""

from __future__ import annotations

import struct
import sys
import zlib
from pathlib import Path

import numpy as np

from starling.patterns import regular_file
from starling.patterns.errors import InputError, refuse
from starling.patterns.field import LARGEST_SIDE_PX, SMALLEST_SIDE_PX
from starling.patterns.pattern import Pattern

PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"

Chunks = list[tuple[bytes, bytes]]  # Kind and data of each chunk of a PNG.

_CHANNELS = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}  # Channels by colour type.
_PALETTE = 3  # Colour type whose values are numbers of a palette.
_LAST_FILTER = 4  # Greatest number of a filter, the first byte of each row.
# First column and row, and steps, of the passes of images with and without interlacing.
_WHOLE = ((0, 0, 1, 1),)
_ADAM7 = (
    *((0, 0, 8, 8), (4, 0, 8, 8), (0, 4, 4, 8), (2, 0, 4, 4), (0, 2, 2, 4), (1, 0, 2, 2)),
    (0, 1, 1, 2),
)


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
        content = regular_file.read(path)
    except OSError as error:
        value = f"{path} ({error.strerror})"
        raise refuse("pattern file", "must be readable", value, "Check the path.") from error
    if not content.startswith(PNG_SIGNATURE):
        raise refuse("pattern file", "must be a PNG", path, "Convert it to a grey PNG.")
    try:
        chunks = png_chunks(content)
        _check_header(path, chunks)
        plain = plain_png(chunks)
    except InputError:
        raise
    except ValueError as error:
        raise _damaged(path) from error
    import cv2  # Heavy, and needed here only.

    image = cv2.imdecode(np.frombuffer(plain, np.uint8), cv2.IMREAD_UNCHANGED)
    if image is None:
        raise _damaged(path)
    if not image.any():
        value = f"{path}, all zero"
        raise refuse("pattern file", "must hold some light", value, "Give another image.")
    return Pattern.from_image(
        image, fov_x_deg=fov_x_deg, fov_y_deg=fov_y_deg, name=f"image {path.name}"
    )


def png_chunks(content: bytes) -> Chunks:
    """List kind and data of a PNG's chunks up to IEND, with verified checksums.

    OpenCV silently fills the missing part of a damaged PNG with zeros.

    Args:
        content: file that starts with `PNG_SIGNATURE`.

    Raises:
        ValueError: that names the defect, if the file is cut short or a checksum is wrong.
    """
    chunks: Chunks = []
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


def plain_png(chunks: Chunks) -> bytes:
    """Rebuild a PNG from its header, palette and pixel data, after checking them.

    Decoders print messages for damaged pixel data, and for unusual chunks of other kinds.

    Args:
        chunks: result of `png_chunks`.

    Raises:
        ValueError: that names the defect, if the header is missing or unknown, or the pixel data
            are damaged or have another size.

    Source: W3C, Portable Network Graphics (PNG) Specification, third edition.
    """
    kind, header = chunks[0]
    if kind != b"IHDR" or len(header) != 13 or [name for name, _ in chunks].count(b"IHDR") > 1:
        raise ValueError("no image header")
    width, height, bits, colour, *methods, interlaced = struct.unpack(">IIBBBBB", header)
    if colour not in _CHANNELS or methods != [0, 0] or interlaced > 1:
        raise ValueError("pixel data that does not decode")
    pixel_bits = bits * _CHANNELS[colour]
    rows = [
        (-(-(height - y) // dy), 1 + (-(-(width - x) // dx) * pixel_bits + 7) // 8)
        for x, y, dx, dy in (_ADAM7 if interlaced else _WHOLE)
        if width > x and height > y
    ]
    packed = b"".join(data for kind, data in chunks if kind == b"IDAT")
    size = sum(count * length for count, length in rows)
    inflate = zlib.decompressobj()
    try:
        most = min(size + 1, sys.maxsize)  # A damaged header can announce more.
        pixels = np.frombuffer(inflate.decompress(packed, most), np.uint8)
    except zlib.error as error:
        raise ValueError("too little pixel data") from error
    if len(pixels) != size or not inflate.eof:
        raise ValueError("too little pixel data")
    start = 0
    for count, length in rows:
        end = start + count * length
        if pixels[start:end:length].max() > _LAST_FILTER:
            raise ValueError("pixel data that does not decode")
        start = end
    packed = packed[: len(packed) - len(inflate.unused_data)]
    palette = [chunk for chunk in chunks if chunk[0] == b"PLTE" and colour == _PALETTE]
    kept = [(b"IHDR", header), *palette, (b"IDAT", packed), (b"IEND", b"")]
    return PNG_SIGNATURE + b"".join(
        len(data).to_bytes(4, "big") + kind + data + zlib.crc32(kind + data).to_bytes(4, "big")
        for kind, data in kept
    )


def _check_header(path: Path, chunks: Chunks) -> None:
    """Refuse an image that is not grey or has an unusable size."""
    kinds = dict(chunks)
    header = kinds.get(b"IHDR", b"")
    if len(header) != 13:
        raise _damaged(path)
    width, height = int.from_bytes(header[:4], "big"), int.from_bytes(header[4:8], "big")
    bits, colour = header[8], header[9]
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


def _damaged(path: Path) -> InputError:
    return refuse("pattern file", "must be an intact PNG", path, "Export it again.")
