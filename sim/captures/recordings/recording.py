"""A recording of a depth camera, independent of its file format."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from starling.sim.geometry.frames import Pose
from starling.sim.geometry.pinhole import Pinhole

# Images of a frame. All but `colour` are in the left infrared view.
STREAMS = ("left", "right", "depth", "truth", "colour", "left_off", "right_off")

ReadImage = Callable[[], NDArray[Any]]  # (h, w), or (h, w, 3) red, green, blue.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class ImagerCalibration:
    """Calibration of one imager before rectification, as sensor_msgs/CameraInfo has it."""

    width: int  # [px]
    height: int  # [px]
    matrix: NDArray[np.float64]  # (3, 3) of the distorted image [px].
    distortion: NDArray[np.float64]  # OpenCV's coefficients, 5 or 8.
    model: str = "plumb_bob"
    rotation: NDArray[np.float64] | None = None  # (3, 3) to the rectified view.
    projection: NDArray[np.float64] | None = None  # (3, 4) of the rectified view; [0, 3] = -fx b.

    @property
    def is_distorted(self) -> bool:
        """Whether a coefficient differs from 0."""
        return bool(np.any(self.distortion))


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class RecordedFrame:
    """Images of one time; they are read on demand."""

    time_s: float | None  # Of the camera's own clock where it is known.
    images: Mapping[str, ReadImage]  # By name in `STREAMS`.
    facts: Mapping[str, Any] = field(default_factory=dict)  # Known keys of `frame.json`.
    is_lit: bool | None = None  # Whether the projector was on.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Recording:
    """Frames of one camera and what their source states of it; None where it states nothing."""

    path: Path
    kind: str  # Name of the format, for the summary.
    frames: tuple[RecordedFrame, ...]  # In the order of the source.
    device: str | None = None  # Name of the camera.
    camera: Pinhole | None = None  # Of the left, rectified image.
    baseline_m: float | None = None
    depth_unit_m: float | None = None  # Unit of the values of depth images [m].
    depth_step_m: float | None = None  # Step of floating-point depth, where it was rounded.
    black_level_dn: float | None = None  # Pedestal of the infrared images [DN].
    colour: Pinhole | None = None
    colour_from_left: Pose | None = None
    lenses: tuple[ImagerCalibration, ImagerCalibration] | None = (
        None  # Left and right, where images may be distorted.
    )
    right_from_left: Pose | None = None  # Of the unrectified imagers [m].
    unpaired: int = 0  # Left images without a partner in another stream.
    lost: int = 0  # Damaged images that belong to no frame.
    damage: str = ""  # What is wrong with the file behind the last frame.
    notes: tuple[str, ...] = ()
