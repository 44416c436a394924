"""Files of capture sets: copies, images that are written atomically, and the lock of a folder."""

from __future__ import annotations

import fcntl
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np

from starling.diagnosis.validation.camera.errors import refusal

_LAST_CODE = 65535  # Largest code of a 16 bit depth map.


def copy(folder: Path, to: Path, names: tuple[str, ...]) -> None:
    """Copy the named files that exist in a folder. `to` is created if missing."""
    to.mkdir(parents=True, exist_ok=True)
    for name in names:
        if os.path.lexists(folder / name):
            shutil.copyfile(folder / name, to / name)


def write(path: Path, content: bytes) -> None:
    """Write a file completely or not at all."""
    part = path.with_name(f".{path.name}.part")
    part.write_bytes(content)
    part.replace(path)


def write_image(path: Path, image: np.ndarray) -> None:
    """Write an image (h, w) of uint8 or uint16 as PNG."""
    path.parent.mkdir(parents=True, exist_ok=True)
    done, png = cv2.imencode(".png", image)
    assert done  # Encoding of integer images cannot fail.
    write(path, png.tobytes())


def write_depth(path: Path, depth_m: np.ndarray, unit_m: float) -> None:
    """Write depth (h, w) [m] as 16 bit units, 0 where it is missing or too far."""
    code = np.nan_to_num(np.rint(depth_m / unit_m))
    write_image(path, np.where((code >= 1) & (code <= _LAST_CODE), code, 0).astype(np.uint16))


@contextmanager
def exclusive(folder: Path) -> Iterator[None]:
    """Lock a folder for the duration of the block. The folder is created if missing.

    Raises:
        WithheldError: if another process holds the lock.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / ".lock").open("w") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            rule, advice = "must be used by one run at a time", "End the other run or wait for it."
            raise refusal("folder", rule, f"another run in {folder}", advice) from error
        yield
