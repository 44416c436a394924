"""Image streams of a capture set as features of a LeRobot data set.

Infrared and colour are PNG with three channels, as LeRobot writes images. Infrared of 16 bits keeps
its codes in one channel. Depth is uncompressed TIFF: uint16 [mm], or float32 [m] if the steps of
the set are not 1 mm. Missing depth is 0.

Source: LeRobot 0.6.1. `datasets/image_writer.py` and `datasets/utils.py` define the files,
`configs/video.py` the keys `is_depth_map` and `depth_unit`.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.patterns.errors import refuse
from starling.sim.captures import png
from starling.sim.captures.capture import CapturedScene
from starling.sim.captures.info import CaptureInfo
from starling.sim.geometry.pinhole import Pinhole
from starling.sim.stereo.depth import to_code

MM = 1e-3
_PREFIX = "observation.images."


@dataclass(frozen=True, kw_only=True, slots=True)
class ImageStream:
    """Images of one kind in a capture set."""

    name: str
    file: str  # In the folder of a frame, without `.png`.
    view: Literal["left", "right", "colour"] = "left"
    is_depth: bool = False

    @property
    def key(self) -> str:
        """Name of the feature."""
        return _PREFIX + self.name


STREAMS = (
    ImageStream(name="infrared_left", file="ir_left"),
    ImageStream(name="infrared_right", file="ir_right", view="right"),
    ImageStream(name="infrared_left_off", file="ir_left_off"),
    ImageStream(name="infrared_right_off", file="ir_right_off", view="right"),
    ImageStream(name="depth", file="depth", is_depth=True),
    ImageStream(name="rgb", file="rgb", view="colour"),
    ImageStream(name="rgb_depth", file="depth_colour", view="colour", is_depth=True),
)


def common(scenes: Sequence[CapturedScene]) -> tuple[ImageStream, ...]:
    """Return the streams that all frames have; warn of those that only some have.

    Raises:
        InputError: if there is none.
    """
    frames = [scene.path / str(number) for scene in scenes for number in scene.frames]
    counts = {
        stream: sum((frame / f"{stream.file}.png").is_file() for frame in frames)
        for stream in STREAMS
    }
    partial = [stream.file for stream, count in counts.items() if 0 < count < len(frames)]
    whole = tuple(stream for stream, count in counts.items() if count == len(frames))
    if not whole:
        rule, advice = "must have an image that all frames have", "Export its scenes one by one."
        raise refuse("captures", rule, ", ".join(partial) or "none", advice)
    if partial:
        message = f"{scenes[0].path.parent}: some frames lack {', '.join(partial)}; left out."
        warnings.warn(message, stacklevel=2)
    return whole


def read(
    scene: CapturedScene, number: int, streams: Sequence[ImageStream]
) -> dict[str, NDArray[Any]]:
    """Read the images of a frame by feature, as they are stored.

    Raises:
        InputError: as `CapturedScene.frame`.
    """
    frame, unit_m = scene.frame(number), scene.info.depth_unit_m
    readers = {
        "ir_left": lambda: frame.ir_left,
        "ir_right": lambda: frame.ir_right,
        "ir_left_off": lambda: frame.ir_left_off,
        "ir_right_off": lambda: frame.ir_right_off,
        "depth": lambda: frame.depth_m,
        "rgb": lambda: scene.colour(number),
        "depth_colour": lambda: scene.depth_in_colour_m(number),
    }
    images = {stream.key: np.asarray(readers[stream.file]()) for stream in streams}
    return {
        stream.key: _stored(images[stream.key], unit_m, is_depth=stream.is_depth)
        for stream in streams
    }


def _stored(image: NDArray[Any], unit_m: float, *, is_depth: bool) -> NDArray[Any]:
    """Return an image (h, w, channels) with the values of its file."""
    if not is_depth:
        if image.dtype == np.uint8 and image.ndim == 2:
            return np.repeat(image[..., None], 3, axis=2)
        return image if image.ndim == 3 else image[..., None]
    if unit_m == MM:
        return to_code(image, unit_m)[..., None]
    return np.nan_to_num(image, nan=0.0)[..., None]


def encode(image: NDArray[Any], *, is_depth: bool) -> bytes:
    """Encode an image (h, w, channels) as LeRobot does."""
    if is_depth:
        options = [cv2.IMWRITE_TIFF_COMPRESSION, cv2.IMWRITE_TIFF_COMPRESSION_NONE]
        return cv2.imencode(".tiff", image, options)[1].tobytes()
    return png.encode_colour(image) if image.shape[2] == 3 else png.encode(image[..., 0])


def value_of_level(image: NDArray[Any], unit_m: float, *, is_depth: bool) -> float:
    """Return what LeRobot reads for a step of the image's codes; 8 bits become 0 to 1."""
    if is_depth:
        return 1.0 if image.dtype == np.uint16 else unit_m
    return 1 / 255 if image.dtype == np.uint8 else 1.0


def levels(image: NDArray[Any], unit_m: float) -> NDArray[np.uint16]:
    """Return the codes of an image in steps of `value_of_level`."""
    return to_code(image, unit_m) if image.dtype == np.float32 else image.astype(np.uint16)


def feature(stream: ImageStream, image: NDArray[Any], info: CaptureInfo) -> dict[str, Any]:
    """Describe a stream for `meta/info.json`.

    `camera_matrix` [px] and `left_from_camera` [m] (OpenCV's axes) are additions, which LeRobot
    keeps and ignores.
    """
    facts: dict[str, Any] = {"is_depth_map": stream.is_depth}
    if stream.is_depth:
        facts["depth_unit"] = "mm" if image.dtype == np.uint16 else "m"
    names = ["height", "width", "channels"]
    return {
        "dtype": "image",
        "shape": list(image.shape),
        "names": names,
        "info": facts | _camera(stream, info),
    }


def _camera(stream: ImageStream, info: CaptureInfo) -> dict[str, Any]:
    camera, left_from_camera = Pinhole.from_camera(info), np.eye(4)
    if stream.view == "right":
        left_from_camera[0, 3] = info.baseline_m
    if stream.view == "colour":
        camera, pose = info.colour, info.colour_from_left
        left_from_camera = None if pose is None else np.linalg.inv(np.array(pose))
    facts: dict[str, Any] = {} if camera is None else {"camera_matrix": camera.matrix.tolist()}
    if left_from_camera is not None:
        facts["left_from_camera"] = left_from_camera.tolist()
    return facts
