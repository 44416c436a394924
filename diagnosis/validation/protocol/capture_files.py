"""Files of capture sets: what is copied of them, and images that nobody sees half of."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import cv2
import numpy as np

_LAST_CODE = 65535


def copy(folder: Path, to: Path, names: tuple[str, ...]) -> None:
    """Copy those of a folder's files that are there; `to` is made where it is not."""
    to.mkdir(parents=True, exist_ok=True)
    for name in names:
        if os.path.lexists(folder / name):
            shutil.copyfile(folder / name, to / name)


def write(path: Path, image: np.ndarray) -> None:
    """Write codes (h, w) of 8 or 16 bits as PNG."""
    path.parent.mkdir(parents=True, exist_ok=True)
    done, png = cv2.imencode(".png", image)
    assert done  # Images of whole codes always can be.
    part = path.with_name(f".{path.name}.part")
    part.write_bytes(png.tobytes())
    part.replace(path)


def write_depth(path: Path, depth_m: np.ndarray, unit_m: float) -> None:
    """Write depth (h, w) [m] as whole units of 16 bits, 0 where there is none or it is too far."""
    code = np.nan_to_num(np.rint(depth_m / unit_m))
    write(path, np.where((code >= 1) & (code <= _LAST_CODE), code, 0).astype(np.uint16))
