"""Files of capture sets: copies, and images that are written atomically."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import cv2
import numpy as np

_LAST_CODE = 65535  # Largest code of a 16 bit depth map.


def copy(folder: Path, to: Path, names: tuple[str, ...]) -> None:
    """Copy the named files that exist in a folder. `to` is created if missing."""
    to.mkdir(parents=True, exist_ok=True)
    for name in names:
        if os.path.lexists(folder / name):
            shutil.copyfile(folder / name, to / name)


def write(path: Path, image: np.ndarray) -> None:
    """Write an image (h, w) of uint8 or uint16 as PNG."""
    path.parent.mkdir(parents=True, exist_ok=True)
    done, png = cv2.imencode(".png", image)
    assert done  # Encoding of integer images cannot fail.
    part = path.with_name(f".{path.name}.part")
    part.write_bytes(png.tobytes())
    part.replace(path)


def write_depth(path: Path, depth_m: np.ndarray, unit_m: float) -> None:
    """Write depth (h, w) [m] as 16 bit units, 0 where it is missing or too far."""
    code = np.nan_to_num(np.rint(depth_m / unit_m))
    write(path, np.where((code >= 1) & (code <= _LAST_CODE), code, 0).astype(np.uint16))
