"""PNG images of capture sets: grey with 8 or 16 bits, and colour."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.patterns import errors
from starling.patterns.image import PNG_SIGNATURE, png_chunks

GreyImage = NDArray[np.uint8] | NDArray[np.uint16]

_COLOUR_TYPES = {0: "grey", 2: "colour", 3: "palette", 4: "grey with alpha", 6: "colour with alpha"}
_WIDEST = 16384  # Larger sizes in a header indicate a damaged file [px].


def read(path: Path, name: str, *, shape: tuple[int, int] | None = None) -> GreyImage:
    """Read a grey PNG without any conversion.

    Args:
        path: the file.
        name: name of the image in error messages: `ir_left`.
        shape: size (h, w) by the set's `capture.toml`; another size in the header is refused before
            pixels are decoded. None allows any size.

    Returns:
        (h, w) uint8 or uint16.

    Raises:
        InputError: if the file is missing, no PNG, truncated, damaged, empty, in colour, has
            neither 8 nor 16 bits, or is of another size.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise errors.refuse(
            name, "must be a readable PNG file", path, f"{error.strerror}."
        ) from error
    bits = _checked_bits(data, path, name, shape)
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        raise _damaged(path, name, "pixel data that does not decode") from error
    if image is None or image.ndim != 2 or image.itemsize * 8 != bits:
        raise _damaged(path, name, "pixel data that does not decode")
    return image.astype(np.uint8) if bits == 8 else image.astype(np.uint16)


def encode(image: GreyImage) -> bytes:
    """Encode (h, w) uint8 or uint16 as PNG bytes."""
    if image.ndim != 2 or image.size == 0 or image.dtype not in (np.uint8, np.uint16):
        raise errors.refuse(
            "image",
            "must be (h, w) of 8 or 16 bits",
            f"{image.shape} {image.dtype}",
            "Convert it first.",
        )
    return cv2.imencode(".png", image)[1].tobytes()


def encode_colour(image: NDArray[np.uint8]) -> bytes:
    """Encode (h, w, 3) red, green, blue as PNG bytes."""
    if image.ndim != 3 or image.shape[2] != 3 or image.size == 0 or image.dtype != np.uint8:
        raise errors.refuse(
            "colour image",
            "must be (h, w, 3) of 8 bits",
            f"{image.shape} {image.dtype}",
            "Convert it first.",
        )
    return cv2.imencode(".png", np.ascontiguousarray(image[..., ::-1]))[1].tobytes()


def _checked_bits(data: bytes, path: Path, name: str, shape: tuple[int, int] | None) -> int:
    """Check the file's structure, because decoders pad truncated files; return the bit depth."""
    if not data:
        raise errors.refuse(name, "must be a PNG file", f"{path}, an empty file", "Copy it again.")
    if not data.startswith(PNG_SIGNATURE):
        raise errors.refuse(name, "must be a PNG file", path, "Convert it losslessly to PNG.")
    try:
        chunks = png_chunks(data)
    except ValueError as error:
        raise _damaged(path, name, str(error)) from error
    header = dict(chunks).get(b"IHDR", b"")
    pixels = b"".join(content for kind, content in chunks if kind == b"IDAT")
    if len(header) != 13:
        raise _damaged(path, name, "no image header")
    width, height, bits, colour, _, _, interlaced = struct.unpack(">IIBBBBB", header)
    _check_kind(path, name, width, height, bits, colour)
    if shape is not None and (height, width) != shape:
        rule = f"must be {shape[1]}x{shape[0]} as capture.toml says"
        advice = "Correct the one that is wrong."
        raise errors.refuse(name, rule, f"{path}, {width}x{height}", advice)
    size = height * (1 + width * bits // 8)  # Each row starts with the number of its filter.
    if not interlaced and not _inflates_to(pixels, size):
        raise _damaged(path, name, "too little pixel data")
    return int(bits)


def _inflates_to(data: bytes, size: int) -> bool:
    try:
        return len(zlib.decompressobj().decompress(data, size + 1)) == size
    except zlib.error:
        return False


def _check_kind(path: Path, name: str, width: int, height: int, bits: int, colour: int) -> None:
    if not (1 <= width <= _WIDEST and 1 <= height <= _WIDEST):
        raise errors.refuse(
            name,
            f"must be 1 to {_WIDEST} pixels wide and high",
            f"{path}, {width}x{height}",
            "Copy it again from the source.",
        )
    if colour != 0 or bits not in (8, 16):
        raise errors.refuse(
            name,
            "must be a grey PNG of 8 or 16 bits",
            f"{path}, {bits}-bit {_COLOUR_TYPES.get(colour, f'type {colour}')}",
            "Save one channel, without scaling it.",
        )


def _damaged(path: Path, name: str, defect: str) -> errors.InputError:
    return errors.refuse(
        name, "must be a whole PNG file", f"{path}, {defect}", "Copy it again from the source."
    )
