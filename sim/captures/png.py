"""PNG images of capture sets: grey with 8 or 16 bits, and colour."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.patterns import errors, regular_file
from starling.patterns.image import PNG_SIGNATURE, plain_png, png_chunks

GreyImage = NDArray[np.uint8] | NDArray[np.uint16]

_COLOUR_TYPES = {0: "grey", 2: "colour", 3: "palette", 4: "grey with alpha", 6: "colour with alpha"}
_UNDECODED = "pixel data that does not decode"
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
        data = regular_file.read(path)
    except OSError as error:
        raise errors.refuse(
            name, "must be a readable PNG file", path, f"{error.strerror}."
        ) from error
    return decode(data, path, name, shape=shape)


def decode(
    data: bytes, path: Path, name: str, *, shape: tuple[int, int] | None = None
) -> GreyImage:
    """Decode a grey PNG; arguments, result and errors as `read`."""
    bits, plain = _check(data, path, name, shape, colour=False)
    image = _pixels(plain, path, name)
    if image.ndim != 2 or image.itemsize * 8 != bits:
        raise _damaged(path, name, _UNDECODED)
    return image.astype(np.uint8) if bits == 8 else image.astype(np.uint16)


def decode_colour(
    data: bytes, path: Path, name: str, *, shape: tuple[int, int] | None = None
) -> NDArray[np.uint8]:
    """Decode a colour PNG of 8 bits to (h, w, 3) red, green, blue; otherwise as `decode`."""
    _, plain = _check(data, path, name, shape, colour=True)
    image = _pixels(plain, path, name)
    if image.ndim != 3 or image.shape[2] != 3:
        raise _damaged(path, name, _UNDECODED)
    return np.ascontiguousarray(image[..., ::-1], np.uint8)


def read_picture(path: Path, name: str, *, colour: bool = False) -> NDArray[Any]:
    """Read a picture of any kind: a PNG, or another file that OpenCV decodes. Alpha is ignored.

    Args:
        path: the file.
        name: name of the image in error messages: `rgb`.
        colour: convert grey pictures to colour, and 16 bits to 8.

    Returns:
        (h, w, 3) red, green, blue, or (h, w) grey; uint8 or uint16.

    Raises:
        InputError: if the file is missing or damaged, or has other values than 8 or 16 bits, such
            as the linear ones of HDR.
    """
    try:
        data = regular_file.read(path)
        plain = plain_png(png_chunks(data)) if data.startswith(PNG_SIGNATURE) else data
    except (OSError, ValueError) as error:
        defect = " ".join(str(error).split())
        raise errors.refuse(name, "must be a readable image", path, f"{defect}.") from error
    image = decode_picture(plain, colour=colour)
    if image is None:
        got = path if data else f"{path}, an empty file"
        raise errors.refuse(name, "must be a readable image", got, "Copy it again.")
    if image.dtype not in (np.uint8, np.uint16):
        rule, got = "must be a picture of 8 or 16 bits", f"{path} with {image.dtype}"
        raise errors.refuse(name, rule, got, "Save it as PNG.")
    return np.ascontiguousarray(image[..., ::-1]) if image.ndim == 3 else image


def decode_picture(data: bytes, *, colour: bool = False) -> NDArray[Any] | None:
    """Decode a picture to blue, green, red or grey, without messages; None if damaged."""
    buffer = np.frombuffer(data, np.uint8)
    flags = cv2.IMREAD_COLOR if colour else cv2.IMREAD_ANYCOLOR
    level = cv2.utils.logging.getLogLevel()
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    try:
        image = cv2.imdecode(buffer, flags | cv2.IMREAD_ANYDEPTH)
        if colour and image is not None and image.dtype == np.uint16:
            return cv2.imdecode(buffer, flags)
        return image
    except cv2.error:
        return None
    finally:
        cv2.utils.logging.setLogLevel(level)


def _pixels(data: bytes, path: Path, name: str) -> NDArray:
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        raise _damaged(path, name, _UNDECODED) from error
    if image is None:
        raise _damaged(path, name, _UNDECODED)
    return image


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


def _check(
    data: bytes, path: Path, name: str, shape: tuple[int, int] | None, *, colour: bool
) -> tuple[int, bytes]:
    """Check the file's structure, because decoders pad truncated files.

    Returns:
        The bit depth, and the PNG without chunks that the pixels do not need.
    """
    if not data:
        raise errors.refuse(name, "must be a PNG file", f"{path}, an empty file", "Copy it again.")
    if not data.startswith(PNG_SIGNATURE):
        raise errors.refuse(name, "must be a PNG file", path, "Convert it losslessly to PNG.")
    try:
        chunks = png_chunks(data)
    except ValueError as error:
        raise _damaged(path, name, str(error)) from error
    kinds = dict(chunks)
    header = kinds.get(b"IHDR", b"")
    if len(header) != 13:
        raise _damaged(path, name, "no image header")
    width, height, bits, kind = struct.unpack_from(">IIBB", header)
    _check_kind(path, name, (width, height), bits, kind, colour=colour)
    if shape is not None and (height, width) != shape:
        rule = f"must be {shape[1]}x{shape[0]} as capture.toml says"
        advice = "Correct the one that is wrong."
        raise errors.refuse(name, rule, f"{path}, {width}x{height}", advice)
    if b"tRNS" in kinds:
        raise _damaged(path, name, "a transparent colour")
    try:
        return int(bits), plain_png(chunks)
    except ValueError as error:
        raise _damaged(path, name, str(error)) from error


def _check_kind(
    path: Path, name: str, size: tuple[int, int], bits: int, kind: int, *, colour: bool
) -> None:
    if not all(1 <= side <= _WIDEST for side in size):
        rule = f"must be 1 to {_WIDEST} pixels wide and high"
        advice = "Copy it again from the source."
        raise errors.refuse(name, rule, f"{path}, {size[0]}x{size[1]}", advice)
    value = f"{path}, {bits}-bit {_COLOUR_TYPES.get(kind, f'type {kind}')}"
    if colour and (kind != 2 or bits != 8):
        advice = "Save red, green and blue."
        raise errors.refuse(name, "must be a colour PNG of 8 bits", value, advice)
    if not colour and (kind != 0 or bits not in (8, 16)):
        advice = "Save one channel, without scaling it."
        raise errors.refuse(name, "must be a grey PNG of 8 or 16 bits", value, advice)


def _damaged(path: Path, name: str, defect: str) -> errors.InputError:
    return errors.refuse(
        name, "must be a whole PNG file", f"{path}, {defect}", "Copy it again from the source."
    )
