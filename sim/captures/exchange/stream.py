"""A moving camera's images, depths and poses, whatever layout they come from."""

from __future__ import annotations

import bisect
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from starling.sim.geometry.frames import Pose
from starling.sim.geometry.pinhole import Pinhole

NEAR_S = 0.02  # Times that are taken for one.

_T = TypeVar("_T")


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Moment:
    """One step of time."""

    time_s: float
    world_from_camera: Pose | None  # OpenCV frame; None where no pose is near in time.
    depth: Callable[[], NDArray[np.float32]]  # Reads z [m] (h, w), NaN = none.
    image: Callable[[], NDArray[Any]] | None  # Reads (h, w, 3) or (h, w), 8 or 16 bits.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Stream:
    """All of it, in order of time."""

    camera: Pinhole
    moments: tuple[Moment, ...]


def nearest(timed: Sequence[tuple[float, _T]], time_s: float) -> _T | None:
    """What is nearest in time, None where nothing is within `NEAR_S`; `timed` is in its order."""
    at = bisect.bisect_left(timed, time_s, key=lambda one: one[0])
    around = timed[max(at - 1, 0) : at + 1]
    if not around:
        return None
    found_s, found = min(around, key=lambda one: abs(one[0] - time_s))
    return found if abs(found_s - time_s) <= NEAR_S else None
