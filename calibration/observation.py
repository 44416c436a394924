"""What a fit looks at: the images of one captured scene and the surface they show."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from patterns import errors
from sim.capture import CapturedScene
from sim.capture_info import CaptureInfo
from sim.depth import disparity_from_depth
from sim.imager.exposure import Exposure
from sim.scene import Scene
from sim.sensor import Sensor

Array = NDArray[np.float32]


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Observation:
    """One captured scene: the first frame's images, each (h, w), None where there is none."""

    name: str
    room: str  # Scenes of one room share it; what is held out is held out by room.
    info: CaptureInfo  # Geometry that the captures claim.
    left: Array | None  # [DN], black level included.
    right: Array | None
    left_off: Array | None  # Projector off.
    right_off: Array | None
    depth_m: Array | None  # The device's own, NaN = no depth.
    truth_m: Array | None  # Reference depth in the left view, NaN = unknown.
    scene: Scene | None  # Surface, None where neither mesh nor reference depth is known.
    metric: bool  # Whether the surface is known without the imager's intrinsics (a posed mesh).
    exposure: Exposure | None = None  # That the camera recorded for the first frame.
    repeats: NDArray[np.uint8] | NDArray[np.uint16] | None = (
        None  # (n, h, w) left, at rest, n >= 2.
    )


def load(scene: CapturedScene, sensor: Sensor, *, smoothing_px: float = 0.0) -> Observation:
    """Read one scene of a capture set and what its surface is.

    A posed mesh (`scene.toml`) is taken before reference depth: it alone tells focal length and
    baseline apart.

    Args:
        scene: of a capture set.
        sensor: that the captures are of, as far as its geometry and lens go.
        smoothing_px: see `sim.scenes.captured.load`; posed meshes have reflectance of their own.

    Raises:
        InputError: whatever is wrong with the files.
    """
    from sim.scenes import captured, known

    frames = [scene.frame(number) for number in scene.frames]
    first, truth = frames[0], scene.truth_m()
    surface = known.load(scene, sensor)
    metric = surface is not None
    if surface is None and truth is not None and first.ir_left is not None:
        surface = captured.load(scene.path, sensor, smoothing_px=smoothing_px)
    still = [
        frame.ir_left for frame in frames if frame.record.get("counts", "repeats") == "repeats"
    ]
    rows: list[NDArray[Any]] = [image for image in still if image is not None]
    return Observation(
        name=scene.name,
        room=scene.room,
        info=scene.info,
        left=_float(first.ir_left),
        right=_float(first.ir_right),
        left_off=_float(first.ir_left_off),
        right_off=_float(first.ir_right_off),
        depth_m=first.depth_m,
        truth_m=truth,
        scene=surface,
        metric=metric,
        exposure=_exposure(first.record),
        repeats=np.stack(rows) if len(rows) > 1 else None,
    )


def load_all(scenes: Iterable[CapturedScene], sensor: Sensor) -> tuple[Observation, ...]:
    """Read several scenes (see `load`).

    Raises:
        InputError: if there is none, or as `load`.
    """
    observations = tuple(load(scene, sensor) for scene in scenes)
    if not observations:
        raise errors.refuse("captures", "must hold a scene", "none", "Name a capture set.")
    return observations


def truth_px(observation: Observation) -> Array | None:
    """Disparity (h, w) [px] that the reference depth means, NaN where unknown."""
    if observation.truth_m is None:
        return None
    info = observation.info
    return disparity_from_depth(
        observation.truth_m, focal_px=info.fx_px, baseline_m=info.baseline_m
    )


def _exposure(record: Mapping[str, Any]) -> Exposure | None:
    seconds, gain = record.get("exposure_s"), record.get("gain")
    if not isinstance(seconds, (int, float)) or not isinstance(gain, (int, float)):
        return None
    return Exposure(exposure_s=float(seconds), gain=float(gain))


def _float(image: NDArray | None) -> Array | None:
    return None if image is None else image.astype(np.float32)
