"""What the formats of the fuzz tests share: a format, and content of small files."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from tests.system.mutations import Mutator

SHAPE = (24, 32)
IDENTITY = np.eye(4).tolist()
PINHOLE = {"width": 32, "height": 24, "fx_px": 30.0, "fy_px": 30.0, "cx_px": 15.5, "cy_px": 11.5}
INFO = {
    "sensor": "d415",
    **PINHOLE,
    **{"baseline_m": 0.05, "depth_unit_m": 0.001, "black_level_dn": 4.0},
    **{"source": "a test", "licence": "Apache-2.0", "notes": "", "preset": "Default"},
    **{"projector": "on", "distortion": [0.0] * 5, "colour": PINHOLE},
    "colour_from_left": IDENTITY,
}
RECORD = {
    **{"timestamp": 1.5, "exposure_s": 0.01, "gain": 1.0, "laser_power": 150, "counts": "repeats"},
    **{"left_from_world": IDENTITY, "bodies": ["floor", "cup"]},
    "objects": [{"body": "cup", "mesh": "cup.ply", "left_from_mesh": IDENTITY}],
}


@dataclass(frozen=True, kw_only=True, slots=True)
class Format:
    """A file format."""

    write: Callable[[Path], Path]  # Writes a valid file and its neighbours into a folder.
    read: Callable[[Path], object]  # Reads the file, or the folder that it is in.
    mutator: Mutator
    native: bool = False  # The library can abort the process: it is read in a process of its own.
    slow: bool = False  # One read takes tens of milliseconds.


def plain_file(name: str, content: bytes) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        path = folder / name
        path.write_bytes(content)
        return path

    return write


def as_json(values: object) -> bytes:
    return json.dumps(values).encode()


def as_toml(values: dict[str, Any]) -> bytes:
    return tomli_w.dumps(values).encode()


def depth_codes(dtype: type[np.generic] = np.uint16) -> np.ndarray:
    rows = np.arange(SHAPE[0] * SHAPE[1]).reshape(SHAPE)
    return (rows % 200 + 20).astype(dtype)
