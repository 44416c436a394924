"""A moving camera's images, depths and poses, whatever layout they come from."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.frames import Pose
from sim.pinhole import Pinhole


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Moment:
    """One step of time."""

    time_s: float
    world_from_camera: Pose | None  # OpenCV frame; None where no pose is near in time.
    depth: Callable[[], NDArray[np.float32]]  # Reads z [m] (h, w), NaN = none.
    image: Callable[[], NDArray[Any]] | None  # Reads (h, w, 3) or (h, w) of 8 bits.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Stream:
    """All of it, in order of time."""

    camera: Pinhole
    moments: tuple[Moment, ...]
