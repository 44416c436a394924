"""Messages of ROS 1 and 2: images, compressed images, intrinsics, transforms, texts.

Sources: sensor_msgs/Image, CompressedImage, CameraInfo; REP 118 (16UC1 depth is in millimetres,
32FC1 in metres); image_transport_plugins (compressed formats); librealsense 2.56.5,
`realsense-file/rosbag/msgs` (its images end with the depth unit if their header has version 1).
"""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.patterns import errors
from starling.patterns.image import PNG_SIGNATURE, plain_png, png_chunks
from starling.sim.captures import png
from starling.sim.captures.exchange.ros_types import typestore
from starling.sim.captures.recordings.logs.message_log import LoggedMessage, LostMessageError

IMAGE, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
_GREY = {
    **dict.fromkeys(("mono8", "8UC1"), "u1"),
    **dict.fromkeys(("mono16", "16UC1"), "u2"),
    "32FC1": "f4",
}
_COLOUR = {  # Channels, and those of red, green and blue.
    "rgb8": (3, (0, 1, 2)),
    "bgr8": (3, (2, 1, 0)),
    "rgba8": (4, (0, 1, 2)),
    "bgra8": (4, (2, 1, 0)),
}
_PACKED = {  # Two bytes a pixel, colour shared by two pixels.
    **dict.fromkeys(("yuv422", "uyvy", "UYVY"), cv2.COLOR_YUV2RGB_UYVY),
    **dict.fromkeys(("yuv422_yuy2", "yuyv", "YUYV"), cv2.COLOR_YUV2RGB_YUY2),
}
_CODECS = ("png", "jpeg", "jpg")
_DEPTH_HEADER = 12  # Bytes before the PNG of `compressedDepth`: format and two coefficients.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class ImageMessage:
    """One image of a topic, as its message holds it."""

    time_s: float  # Time stamp of the header; 0 where it has none.
    frame: str  # Name of the frame of reference.
    encoding: str
    codec: str  # Format of a compressed image; empty for plain pixels.
    size: tuple[int, int]  # Width and height [px]; (0, 0) for compressed images.
    step: int  # Bytes of a row.
    is_big: bool
    data: Any
    depth_unit_m: float | None = None


def parse(entry: LoggedMessage, *, is_ros1: bool) -> Any:
    """Return a message as `rosbags` decodes it.

    Raises:
        LostMessageError: if its data are damaged.
    """
    types = typestore(is_ros1=is_ros1)
    decode = types.deserialize_ros1 if is_ros1 else types.deserialize_cdr
    try:
        return decode(entry.read(), entry.kind)
    except LostMessageError:
        raise
    except Exception as error:  # The library raises what its generated code meets.
        raise LostMessageError(f"{entry.topic}: {error}") from error


def image(entry: LoggedMessage, *, is_ros1: bool) -> ImageMessage:
    """Return an image message, plain or compressed.

    Raises:
        LostMessageError: if its data are damaged.
    """
    if is_ros1 and entry.kind == IMAGE:
        return _ros1_image(entry)
    message = parse(entry, is_ros1=is_ros1)
    stamp = message.header.stamp
    common = {"time_s": stamp.sec + stamp.nanosec / 1e9, "frame": message.header.frame_id}
    if entry.kind == COMPRESSED:
        encoding, _, codec = message.format.rpartition(";")
        unpacked = {"size": (0, 0), "step": 0, "is_big": False}
        codec = codec.strip() or "unknown"
        return ImageMessage(
            **common, **unpacked, encoding=encoding.strip(), codec=codec, data=message.data
        )
    size = (message.width, message.height)
    return ImageMessage(
        **common,
        encoding=message.encoding,
        codec="",
        size=size,
        step=message.step,
        is_big=bool(message.is_bigendian),
        data=message.data,
    )


def _ros1_image(entry: LoggedMessage) -> ImageMessage:
    """Parse an image of ROS 1, also with the depth unit that librealsense appends."""
    data = entry.read()
    try:
        seconds, rest = struct.unpack_from("<II", data, 4)
        frame, place = _text(data, 12)
        height, width = struct.unpack_from("<II", data, place)
        encoding, place = _text(data, place + 8)
        is_big, step, count = struct.unpack_from("<BII", data, place)
        place += 9
        if place + count > len(data):
            raise LostMessageError(f"{entry.topic}: an image is cut")
        unit = (
            struct.unpack_from("<f", data, place + count) if place + count + 4 <= len(data) else 0
        )
    except (struct.error, UnicodeDecodeError) as error:
        raise LostMessageError(f"{entry.topic}: {error}") from error
    return ImageMessage(
        time_s=seconds + rest / 1e9,
        frame=frame,
        encoding=encoding,
        codec="",
        size=(width, height),
        step=step,
        is_big=bool(is_big),
        data=memoryview(data)[place : place + count],
        depth_unit_m=float(f"{unit[0]:.7g}") if unit and unit[0] > 0 else None,
    )


def _text(data: bytes, place: int) -> tuple[str, int]:
    """Return a text of ROS 1 and the place behind it."""
    (length,) = struct.unpack_from("<I", data, place)
    return data[place + 4 : place + 4 + length].decode(), place + 4 + length


def key_value(entry: LoggedMessage) -> tuple[str, str]:
    """Return key and value of a diagnostic_msgs/KeyValue of ROS 1.

    Raises:
        LostMessageError: if its data are damaged.
    """
    try:
        data = entry.read()
        key, place = _text(data, 0)
        return key, _text(data, place)[0]
    except (struct.error, UnicodeDecodeError) as error:
        raise LostMessageError(f"{entry.topic}: {error}") from error


def pixels(message: ImageMessage, topic: str) -> NDArray[Any]:
    """Return the pixels of a message: (h, w) grey or depth, or (h, w, 3) red, green, blue.

    Raises:
        InputError: if the encoding or codec is unknown.
        LostMessageError: if there are fewer bytes than pixels.
    """
    if message.codec:
        return _decompressed(message, topic)
    (width, height), encoding = message.size, message.encoding
    kind, channels = _GREY.get(encoding, "u1"), 1
    if encoding in _COLOUR:
        channels = _COLOUR[encoding][0]
    elif encoding in _PACKED:
        channels = 2
    elif encoding not in _GREY:
        known = ", ".join([*_GREY, *_COLOUR, "yuv422", "yuyv"])
        rule, got = f"must have an encoding of {known}", encoding or "none"
        raise errors.refuse(topic, rule, got, "Record it without conversion, or convert it.")
    row = width * channels * np.dtype(kind).itemsize
    data = np.frombuffer(message.data, np.uint8)
    if message.step < row or data.size < message.step * height or not data.size:
        raise LostMessageError(f"{topic}: an image is cut")
    rows = np.ascontiguousarray(data[: message.step * height].reshape(height, -1)[:, :row])
    order = ">" if message.is_big else "<"
    image = rows.view(np.dtype(kind).newbyteorder(order)).astype(kind)
    if encoding in _PACKED:
        return cv2.cvtColor(image.reshape(height, width, 2), _PACKED[encoding])
    if encoding in _COLOUR:
        return np.ascontiguousarray(image.reshape(height, width, -1)[..., _COLOUR[encoding][1]])
    return image


def _decompressed(message: ImageMessage, topic: str) -> NDArray[Any]:
    words = re.split(r"[ ,]+", message.codec.lower())
    data = bytes(message.data)
    if "compresseddepth" in words:
        if "png" not in words and len(words) > 1:
            raise _unknown_codec(message.codec, topic)
        scale, shift = struct.unpack_from("<ff", data, 4)
        code = _decoded(data[_DEPTH_HEADER:], topic)
        if message.encoding != "32FC1":
            return code
        with np.errstate(divide="ignore"):
            depth_m = np.float32(scale) / (code.astype(np.float32) - np.float32(shift))
        return np.where(code > 0, depth_m, np.float32(np.nan)).astype(np.float32)
    if not any(word in _CODECS for word in words):
        raise _unknown_codec(message.codec, topic)
    return _decoded(data, topic)


def _unknown_codec(codec: str, topic: str) -> errors.InputError:
    rule = "must be compressed by png, jpeg or compressedDepth png"
    return errors.refuse(topic, rule, codec, "Record the plain topic, or republish it.")


def _decoded(data: bytes, topic: str) -> NDArray[Any]:
    try:
        plain = plain_png(png_chunks(data)) if data.startswith(PNG_SIGNATURE) else data
    except ValueError as error:
        raise LostMessageError(f"{topic}: {error}") from error
    image = png.decode_picture(plain) if plain else None
    if image is None:
        raise LostMessageError(f"{topic}: an image is damaged")
    return np.ascontiguousarray(image[..., ::-1]) if image.ndim == 3 else image
