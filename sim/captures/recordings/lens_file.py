"""Calibrations of unrectified imagers: camera_info of ROS in YAML with K, D, R and P."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from starling.patterns import errors
from starling.sim import files
from starling.sim.captures.recordings.recording import ImagerCalibration

_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
_KEY = re.compile(r"^([A-Za-z_]\w*)\s*:", re.MULTILINE)
_NAMES = {
    "width": ("width", "image_width"),
    "height": ("height", "image_height"),
    "k": ("k", "camera_matrix"),
    "d": ("d", "distortion_coefficients"),
    "r": ("r", "rectification_matrix"),
    "p": ("p", "projection_matrix"),
    "model": ("distortion_model",),
}


def read(path: Path) -> ImagerCalibration:
    """Read a camera_info with all its matrices.

    Raises:
        InputError: if a key is missing or has too few numbers.
    """
    text = files.read_text(path)
    keys = list(_KEY.finditer(text))
    ends = [*(key.start() for key in keys[1:]), len(text)]
    blocks = {key[1].lower(): text[key.end() : end] for key, end in zip(keys, ends, strict=False)}
    values = {
        name: next((blocks[key] for key in choices if key in blocks), "")
        for name, choices in _NAMES.items()
    }
    rotation, projection = (_numbers(values[key]) for key in "rp")
    sizes = [_numbers(values[key]) for key in ("width", "height")]
    matrix = _numbers(values["k"])
    counts = [len(matrix), *(len(size) for size in sizes), len(rotation), len(projection)]
    if counts[:3] != [9, 1, 1] or counts[3] not in (0, 9) or counts[4] not in (0, 12):
        rule = "must be a camera_info with width, height, K, D, R and P"
        raise errors.refuse(path.name, rule, path, "Write it by ROS' camera_calibration.")
    return ImagerCalibration(
        width=int(sizes[0][0]),
        height=int(sizes[1][0]),
        matrix=matrix.reshape(3, 3),
        distortion=_numbers(values["d"]),
        model=values["model"].strip() or "plumb_bob",
        rotation=rotation.reshape(3, 3) if len(rotation) else None,
        projection=projection.reshape(3, 4) if len(projection) else None,
    )


def _numbers(block: str) -> NDArray[np.float64]:
    """Return the numbers of a list; `data:` starts it in a matrix with rows and columns."""
    listed = block.rpartition("data:")[2]
    return np.array([float(word) for word in _NUMBER.findall(listed)])
