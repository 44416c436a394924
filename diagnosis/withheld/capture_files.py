"""Files of capture sets: what is copied of them, and images that nobody sees half of."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import cv2
import numpy as np


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
