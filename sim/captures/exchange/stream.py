"""An RGB-D stream: images, depth and poses of a moving camera, independent of the layout."""

from __future__ import annotations

import bisect
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from starling.patterns.errors import refuse
from starling.sim.captures import png
from starling.sim.geometry.frames import Pose
from starling.sim.geometry.pinhole import Pinhole
from starling.sim.stereo.depth import from_code

NEAR_S = 0.02  # Times within this difference count as equal [s].

_T = TypeVar("_T")


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Moment:
    """Image, depth and pose at one time."""

    time_s: float
    world_from_camera: Pose | None  # OpenCV frame; None without a pose within `NEAR_S`.
    depth: Callable[[], NDArray[np.float32]]  # Reads z [m] (h, w), NaN = none.
    image: Callable[[], NDArray[Any]] | None  # Reads (h, w, 3) or (h, w), 8 or 16 bits.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Stream:
    """Moments of one camera, in order of time."""

    camera: Pinhole
    moments: tuple[Moment, ...]


def nearest(timed: Sequence[tuple[float, _T]], time_s: float) -> _T | None:
    """Return the item nearest in time, or None if none is within `NEAR_S`; `timed` is sorted."""
    index = bisect.bisect_left(timed, time_s, key=lambda pair: pair[0])
    around = timed[max(index - 1, 0) : index + 1]
    if not around:
        return None
    nearest_s, item = min(around, key=lambda pair: abs(pair[0] - time_s))
    return item if abs(nearest_s - time_s) <= NEAR_S else None


def read_text(path: Path) -> str:
    """Read a text file.

    Raises:
        InputError: if the file cannot be read, or is not UTF-8.
    """
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise refuse(path.name, "must be readable", path, f"{error}.") from error


def read_depth(path: Path, unit_m: float) -> NDArray[np.float32]:
    """Read depth z [m] (h, w), NaN = none, from 16-bit codes.

    Raises:
        InputError: if the file cannot be read, or has 8 bits.
    """
    code = png.read(path, "depth")
    if code.dtype != np.uint16:
        raise refuse("depth", "must be of 16 bits", f"{path}, 8-bit", "Extract it again.")
    return from_code(code.astype(np.uint16), unit_m)
