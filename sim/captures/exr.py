"""One frame's layers, ground truth and depth in one multi-part OpenEXR file.

Radiance, depth and disparity are stored as 32-bit float, without loss. Normals are stored as half:
11 bits of mantissa resolve 0.03 deg, finer than any mesh here. Normals already rounded to half are
preserved exactly. Codes and masks are uint32, the only integer type of OpenEXR.

The OpenEXR library does not report all truncated or damaged files: it prints a message, omits the
part and continues. It may also miss a full disk while writing. `check_structure` therefore walks
the file. Layout: https://openexr.com/en/latest/OpenEXRFileLayout.html
"""

from __future__ import annotations

import errno
import struct
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from starling.patterns import errors, regular_file
from starling.sim.captures import library_path
from starling.sim.reason import Reason
from starling.sim.render.layers import Layers, Truth, ViewLayers
from starling.sim.stereo.depth import DepthMap

_VIEW: dict[str, tuple[type[np.generic], str]] = {
    "projector_direct": (np.float32, "W m^-2 sr^-1 for 1 W"),
    "projector_indirect": (np.float32, "W m^-2 sr^-1 for 1 W"),
    "ambient": (np.float32, "W m^-2 sr^-1 for 1 W m^-2"),
    "other": (np.float32, "W m^-2 sr^-1"),
    "depth_m": (np.float32, "m, z along this imager's axis, NaN = no surface"),
    "body": (np.uint32, "object number from 1, 0 = no surface"),
}
_NORMAL = ("normal.x", "normal.y", "normal.z")

# Part -> channel -> (type on disk, unit).
_LAYOUT: dict[str, dict[str, tuple[type[np.generic], str]]] = {
    "left": _VIEW,
    "right": _VIEW,
    "truth": {
        "depth_m": (np.float32, "m, z along the optical axis, NaN = no surface"),
        **{
            name: (np.float16, "unit vector, left frame (x right, y down, z ahead)")
            for name in _NORMAL
        },
        "material": (np.uint32, "object number from 1, 0 = no surface"),
        "right_sees": (np.uint32, "1 = the right imager sees the point"),
        "lit": (np.uint32, "1 = the projector reaches the point"),
    },
    "depth": {
        "disparity_px": (np.float32, "px, x_left - x_right, NaN = none"),
        "depth_m": (np.float32, "m, z along the optical axis, NaN = none"),
        "reason": (np.uint32, ", ".join(f"{code.value} {code.name}" for code in Reason)),
    },
}

_MAGIC = b"\x76\x2f\x31\x01"
_MULTIPART = 1 << 12
_ZIP = 3
_LINES = 16  # Scan lines per chunk of ZIP compression.
_BYTES = {0: 4, 1: 2, 2: 4}  # Bytes of the pixel types uint, half and float.
_TYPES = {  # Type of each attribute that determines how the library decodes pixels.
    "channels": "chlist",
    "chunkCount": "int",
    "compression": "compression",
    "dataWindow": "box2i",
    "displayWindow": "box2i",
    "lineOrder": "lineOrder",
    "name": "string",
    "type": "string",
}
_WIDEST = 16384  # Largest accepted width and height [px].


def write(path: Path, layers: Layers, depth: DepthMap) -> None:
    """Write the file.

    Raises:
        OSError: if the file is incomplete. The library itself may not report a full disk.
    """
    import OpenEXR

    arrays = _arrays(layers, depth)
    parts = [
        OpenEXR.Part(
            {
                "type": OpenEXR.scanlineimage,
                "compression": OpenEXR.ZIP_COMPRESSION,
                **{f"unit {channel}": unit for channel, (_, unit) in channels.items()},
            },
            {
                channel: np.ascontiguousarray(arrays[part][channel], kind)
                for channel, (kind, _) in channels.items()
            },
            part,
        )
        for part, channels in _LAYOUT.items()
        if part in arrays
    ]
    try:
        with library_path.for_writing(path) as place:
            OpenEXR.File(parts).write(place)
        check_structure(path.read_bytes(), pixels=False)
    except RuntimeError as error:
        code = errno.ENOSPC if "No space left" in str(error) else errno.EIO
        raise OSError(code, str(error)) from error
    except DamagedError as error:
        raise OSError(errno.ENOSPC, f"the file came out damaged: {error}") from error


def read(path: Path) -> tuple[Layers, DepthMap]:
    """Read a file that `write` wrote.

    Raises:
        InputError: if the file is missing, no OpenEXR file, truncated, damaged, or lacks a part or
            channel.
    """
    import OpenEXR

    try:
        data = regular_file.read(path)
    except OSError as error:
        raise errors.refuse("EXR file", "must be readable", path, f"{error.strerror}.") from error
    try:  # Check first: the library only prints a message and skips what it cannot read.
        check_structure(data)
    except DamagedError as error:
        raise errors.refuse(
            "EXR file", "must be a whole OpenEXR file", f"{path}, {error}", "Simulate it again."
        ) from error
    try:
        with (
            library_path.for_reading(path) as place,
            OpenEXR.File(place, separate_channels=True) as file,
        ):
            parts = {
                part.name(): {name: channel.pixels for name, channel in part.channels.items()}
                for part in file.parts  # The file's own dicts are emptied when it closes.
            }
    except (RuntimeError, ValueError, TypeError) as error:
        raise errors.refuse("EXR file", "must be readable", path, f"{error}.") from error
    needed = [part for part in _LAYOUT if part != "right" or part in parts]
    arrays = {part: _channels(path, part, parts.get(part)) for part in needed}
    _check_sizes(path, arrays)
    return _layers(arrays), _depth(arrays["depth"])


def _arrays(layers: Layers, depth: DepthMap) -> dict[str, dict[str, NDArray[Any]]]:
    truth, views = layers.truth, {"left": layers.left}
    if layers.right is not None:
        views["right"] = layers.right
    return {
        **{side: {name: getattr(view, name) for name in _VIEW} for side, view in views.items()},
        "truth": {
            "depth_m": truth.depth_m,
            **{name: truth.normal[..., axis] for axis, name in enumerate(_NORMAL)},
            "material": truth.material,
            "right_sees": truth.right_sees,
            "lit": truth.lit,
        },
        "depth": {name: getattr(depth, name) for name in _LAYOUT["depth"]},
    }


def _channels(path: Path, part: str, channels: dict[str, Any] | None) -> dict[str, NDArray[Any]]:
    """Return the known channels of one part; other channels are ignored."""
    if channels is None:
        raise errors.refuse(
            "EXR file",
            f"must have the parts {', '.join(_LAYOUT)}",
            f"{path} without {part}",
            "Is it a frame.exr that starling wrote?",
        )
    taken = {}
    for name, (kind, _) in _LAYOUT[part].items():
        pixels = channels.get(name)
        if pixels is None or pixels.dtype != kind or pixels.ndim != 2:
            raise errors.refuse(
                "EXR file",
                f"must have the channel {name} of {np.dtype(kind).name} in part {part}",
                f"{path} with {', '.join(channels)}",
                "Is it a frame.exr that starling wrote?",
            )
        taken[name] = pixels
    return taken


def _check_sizes(path: Path, arrays: dict[str, dict[str, NDArray[Any]]]) -> None:
    shapes = {array.shape for channels in arrays.values() for array in channels.values()}
    if len(shapes) > 1:
        raise errors.refuse(
            "EXR file",
            "must hold parts of one size",
            f"{path}, {sorted(shapes)}",
            "Simulate it again.",
        )


def _view(arrays: dict[str, Any]) -> ViewLayers:
    return ViewLayers(**arrays)


def _layers(arrays: dict[str, dict[str, NDArray[Any]]]) -> Layers:
    truth = arrays["truth"]
    return Layers(
        left=_view(arrays["left"]),
        right=_view(arrays["right"]) if "right" in arrays else None,
        truth=Truth(
            depth_m=truth["depth_m"],
            normal=np.stack([truth[name] for name in _NORMAL], axis=-1).astype(np.float32),
            material=truth["material"],
            right_sees=truth["right_sees"] > 0,
            lit=truth["lit"] > 0,
        ),
    )


def _depth(channels: dict[str, NDArray[Any]]) -> DepthMap:
    return DepthMap(
        disparity_px=channels["disparity_px"],
        depth_m=channels["depth_m"],
        valid=channels["reason"] == Reason.VALID,
        reason=channels["reason"],
    )


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


def check_structure(data: bytes, *, pixels: bool = True) -> None:
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
        kind, position = _string(data, position)
        if kind != _TYPES.get(name, kind) or name in attributes:
            raise DamagedError(f"a damaged attribute {name}")
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
