"""Depth images of simulators, from NumPy, PNG and OpenEXR files."""

from __future__ import annotations

import re
import warnings
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from starling.patterns import errors, regular_file
from starling.sim import quantities
from starling.sim.arrays import Image
from starling.sim.captures import library_path, png

SUFFIXES = (".npy", ".png", ".exr")
UNITS = {"m": 1.0, "mm": 1e-3}
_CHANNELS = ("Z", "depth", "V")  # Usual names of the channel of depth.
_GREY = {"R", "G", "B"}  # Depth written as a grey picture.


def files(path: Path) -> list[Path]:
    """List the depth images of a file or folder, numbers in names in their order.

    Returns:
        Nothing for a path of another kind.
    """
    if path.suffix.lower() in SUFFIXES and not path.is_dir():
        return [path]
    if not path.is_dir():
        return []
    return [] if other_in(path) else sorted(_visible(path), key=order)


def other_in(path: Path) -> Path | None:
    """Return the first visible entry of a folder that is no depth image; None if all are."""
    if not path.is_dir():
        return None
    others = (each for each in _visible(path) if not _is_depth_image(each))
    return min(others, default=None)


def _visible(folder: Path) -> list[Path]:
    return [each for each in folder.iterdir() if not each.name.startswith(".")]


def _is_depth_image(path: Path) -> bool:
    return path.is_file() and path.suffix.lower() in SUFFIXES


def order(path: Path) -> tuple[list[tuple[int, str]], str]:
    """Return a sort key of a file's name, in which numbers count as such; equal ones by name."""
    parts = re.split(r"([0-9]+)", path.stem)
    key = [(int(part), "") if odd else (-1, part) for part, odd in zip(parts, cycle((0, 1)))]
    return key, path.name


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
    if image.dtype.itemsize == 1 and not unit:
        message = "8-bit depth images are taken as millimetres, up to 0.255 m. Give their unit."
        warnings.warn(message, stacklevel=1)  # One place, so that it is shown once.
    with np.errstate(over="ignore"):  # Larger depths become infinite, which is no surface.
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
    except (OSError, ValueError, EOFError, OverflowError, TypeError) as error:
        rule = "must be a whole NumPy array"
        raise errors.refuse("depth image", rule, path, f"{error}.") from error
    if not isinstance(mapped, np.ndarray):
        raise errors.refuse("depth image", "must be one array", path, "Save it with np.save.")
    _refuse_size(path, mapped.shape)
    return np.array(mapped)


def _exr(path: Path) -> NDArray[Any]:
    """Read the channel of depth, from whichever part has it."""
    import OpenEXR

    try:
        regular_file.refuse_others(path)
        with library_path.for_reading(path) as place:
            with OpenEXR.File(place, header_only=True) as file:
                windows = [_windows(part.header) for part in file.parts]
                stated = [{each.name for each in part.header["channels"]} for part in file.parts]
            for (left, top, right, bottom), _ in windows:
                _refuse_size(path, (bottom - top + 1, right - left + 1))
            with OpenEXR.File(place, separate_channels=True) as file:
                parts = [
                    {name: each.pixels for name, each in part.channels.items()}
                    for part in file.parts
                ]
    except (OSError, RuntimeError, ValueError, TypeError, KeyError, IndexError) as error:
        rule = "must be a whole OpenEXR file"
        raise errors.refuse("depth image", rule, path, f"{error}.") from error
    if [set(part) for part in parts] != stated:  # The library omits what it cannot read.
        rule = "must be a whole OpenEXR file"
        raise errors.refuse("depth image", rule, path, "Is it cut short, or of mipmap tiles?")
    number, name = _depth_channel(path, parts)
    data, display = windows[number]
    if data != display:
        rule = "must not be cropped: its data window must be its display window"
        raise errors.refuse("depth image", rule, f"{path} with {data} of {display}", "Save all.")
    return np.asarray(parts[number][name])


def _windows(header: Any) -> list[tuple[int, ...]]:
    """Return the data window and the display window, each left, top, right, bottom."""
    names = ("dataWindow", "displayWindow")
    return [tuple(int(side) for corner in header[name] for side in corner) for name in names]


def _depth_channel(path: Path, parts: list[dict[str, Any]]) -> tuple[int, str]:
    """Return the number of the part with depth, and the name of its channel."""
    for name in _CHANNELS:
        for number, channels in enumerate(parts):
            if name in channels:
                return number, name
    names = [name for channels in parts for name in channels]
    if len(names) == 1:
        return 0, names[0]
    if len(parts) == 1 and _GREY <= parts[0].keys() <= _GREY | {"A"}:
        red, *others = (parts[0][name] for name in "RGB")
        if all(np.array_equal(red, other, equal_nan=True) for other in others):
            return 0, "R"
    rule = f"must have one channel, or one of {', '.join(_CHANNELS)}"
    raise errors.refuse("depth image", rule, f"{path} with {names}", "Save depth alone.")


def _refuse_size(path: Path, shape: tuple[int, ...]) -> None:
    if len(shape) == 2:
        for name, side in zip(("height", "width"), shape, strict=True):
            quantities.check(f"{path}: {name}", side, "image_side_px")
