"""One image of a public data set, in the form that all readers return."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.learning.completion.method import Image
from starling.patterns import regular_file
from starling.patterns.errors import refuse
from starling.sim.geometry.pinhole import Pinhole

Colour = NDArray[np.uint8]


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Item:
    """An image with its truth, and a stereo pair or a depth camera's depth."""

    rgb: Colour  # (h, w, 3) red, green, blue; of the left camera of a pair.
    truth_m: Image  # (h, w) z [m], NaN where unknown.
    camera: Pinhole
    baseline_m: float  # Baseline of the pair, or of the depth camera.
    sensor_m: Image | None = None  # (h, w) depth camera's own z [m], NaN where missing.
    right: Colour | None = None  # (h, w, 3) of the right camera, rectified.

    def __post_init__(self) -> None:
        shapes = [self.rgb.shape[:2], self.truth_m.shape, (self.camera.height, self.camera.width)]
        shapes += [] if self.sensor_m is None else [self.sensor_m.shape]
        shapes += [] if self.right is None else [self.right.shape[:2]]
        if len(set(shapes)) > 1:
            advice = "Copy the data set again."
            raise refuse("images of an item", "must have one size", sorted(set(shapes)), advice)


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class ItemSource:
    """An item that is not yet read."""

    name: str  # Unique in its data set.
    room: str  # Room of the image; splits are by room.
    files: tuple[Path, ...]  # Files to read.
    load: Callable[[], Item]  # Raises InputError if a file is missing or damaged.


def read_colour(path: Path) -> Colour:
    """Read a colour image; grey images are converted to colour.

    Returns:
        (h, w, 3) red, green, blue.

    Raises:
        InputError: if it cannot be read.
    """
    return np.ascontiguousarray(_image(path, cv2.IMREAD_COLOR)[..., ::-1], np.uint8)


def read_code(path: Path) -> NDArray[np.uint16]:
    """Read an image of one channel of 16 bits, (h, w).

    Raises:
        InputError: if it cannot be read, or has another format.
    """
    image = _image(path, cv2.IMREAD_UNCHANGED)
    if image.dtype != np.uint16 or image.ndim != 2:
        got = f"{path}, {image.dtype} {image.shape}"
        raise refuse("depth", "must be one channel of 16 bits", got, "Copy it again.")
    return image.astype(np.uint16)


def check_folder(path: Path) -> Path:
    """Return a folder.

    Raises:
        InputError: if it does not exist.
    """
    if not path.is_dir():
        raise refuse("data set", "must be a folder", path, "Unpack the archives there.")
    return path


def _image(path: Path, flags: int) -> NDArray[np.generic]:
    try:
        data = np.frombuffer(regular_file.read(path), np.uint8)
    except OSError as error:
        raise refuse("image", "must be readable", path, f"{error.strerror}.") from error
    image = cv2.imdecode(data, flags) if data.size else None
    if image is None:
        raise refuse("image", "must be a whole image file", path, "Copy it again.")
    return np.asarray(image)
