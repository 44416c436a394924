"""Depth images of simulators, from NumPy, PNG and OpenEXR files."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from starling.patterns import errors, regular_file
from starling.sim import quantities
from starling.sim.arrays import Image
from starling.sim.captures import png

SUFFIXES = (".npy", ".png", ".exr")
UNITS = {"m": 1.0, "mm": 1e-3}
_CHANNELS = ("Z", "depth", "V", "Y", "R")  # Usual names of the channel of depth.


def files(path: Path) -> list[Path]:
    """List the depth images of a file or folder, numbers in names in their order.

    Returns:
        Nothing for a path of another kind.
    """
    if path.suffix.lower() in SUFFIXES and not path.is_dir():
        return [path]
    if not path.is_dir():
        return []
    listed = [each for each in path.iterdir() if not each.name.startswith(".")]
    if not all(each.is_file() and each.suffix.lower() in SUFFIXES for each in listed):
        return []
    return sorted(listed, key=order)


def order(path: Path) -> list[tuple[int, str]]:
    """Return a sort key of a file's name, in which numbers count as such."""
    parts = re.split(r"([0-9]+)", path.stem)
    return [(int(part[:18]), "") if part.isdigit() else (-1, part) for part in parts]


def read(path: Path, unit: str = "") -> Image:
    """Read a depth image [m] (h, w).

    Args:
        path: `.npy`, `.png` or `.exr` file.
        unit: `m`, `mm` or the step of the values [m]. By default floating-point numbers are metres
            and whole numbers millimetres.

    Raises:
        InputError: if the file is missing or damaged, holds no depth image, or the unit is unknown.
    """
    readers = {".npy": _npy, ".png": lambda file: png.read(file, "depth"), ".exr": _exr}
    errors.one_of(f"suffix of {path}", path.suffix.lower(), readers)
    image = readers[path.suffix.lower()](path)
    if image.ndim != 2 or image.dtype.kind not in "fiu" or not image.size:
        got = f"{image.shape} {image.dtype}"
        raise errors.refuse(str(path), "must hold (h, w) numbers", got, "Save one channel.")
    default = "m" if image.dtype.kind == "f" else "mm"
    return np.asarray(image * np.float64(_step(unit or default)), np.float32)


def _step(unit: str) -> float:
    """Return the size of a unit [m]."""
    if unit in UNITS:
        return UNITS[unit]
    try:
        step = float(unit)
    except ValueError:
        step = float("nan")
    limits = quantities.QUANTITIES["depth_unit_m"]
    if not limits.low <= step <= limits.high:
        rule = f"must be m, mm or a step in [{limits.low:g}, {limits.high:g}]"
        raise errors.refuse("depth-unit", rule, unit, limits.remedy)
    return step


def _npy(path: Path) -> NDArray[Any]:
    try:
        regular_file.refuse_others(path)
        mapped = np.load(path, mmap_mode="r", allow_pickle=False)
    except (OSError, ValueError, EOFError, OverflowError) as error:
        rule = "must be a whole NumPy array"
        raise errors.refuse("depth image", rule, path, f"{error}.") from error
    if not isinstance(mapped, np.ndarray):
        raise errors.refuse("depth image", "must be one array", path, "Save it with np.save.")
    _refuse_size(path, mapped.shape)
    return np.array(mapped)


def _exr(path: Path) -> NDArray[Any]:
    """Read the channel of depth of the first part."""
    import OpenEXR

    try:
        regular_file.refuse_others(path)
        with OpenEXR.File(str(path), header_only=True) as file:
            low, high = file.parts[0].header["dataWindow"]
        _refuse_size(path, (int(high[1]) - int(low[1]) + 1, int(high[0]) - int(low[0]) + 1))
        with OpenEXR.File(str(path), separate_channels=True) as file:
            channels = {name: each.pixels for name, each in file.parts[0].channels.items()}
    except (OSError, RuntimeError, ValueError, TypeError, KeyError, IndexError) as error:
        rule = "must be a whole OpenEXR file"
        raise errors.refuse("depth image", rule, path, f"{error}.") from error
    known = [name for name in _CHANNELS if name in channels]
    names = known[:1] if known else list(channels)
    if len(names) != 1:
        rule = f"must have one channel, or one of {', '.join(_CHANNELS)}"
        raise errors.refuse("depth image", rule, f"{path} with {names}", "Save depth alone.")
    return np.asarray(channels[names[0]])


def _refuse_size(path: Path, shape: tuple[int, ...]) -> None:
    if len(shape) == 2:
        for name, side in zip(("height", "width"), shape, strict=True):
            quantities.check(f"{path}: {name}", side, "image_side_px")
