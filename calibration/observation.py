"""What a fit looks at: the images of one captured scene and the surface they show."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from starling.patterns import errors
from starling.sim.captures.capture import CapturedScene
from starling.sim.captures.info import CaptureInfo
from starling.sim.imaging.imager.exposure import Exposure, recorded
from starling.sim.scene.scene import Scene
from starling.sim.sensor.sensor import Sensor

if TYPE_CHECKING:  # Loads the renderer, which takes seconds.
    from starling.sim.render.mitsuba_scene import Stage

Array = NDArray[np.float32]


@dataclass(frozen=True, kw_only=True, eq=False)
class Observation:
    """One captured scene: the first frame's images, each (h, w), None where there is none."""

    name: str
    room: str  # Scenes of one room share it; what is held out is held out by room.
    info: CaptureInfo  # Geometry that the captures claim.
    left: Array | None = None  # [DN], black level included.
    right: Array | None = None
    left_off: Array | None = None  # Projector off.
    right_off: Array | None = None
    depth_m: Array | None = None  # The device's own, NaN = no depth.
    truth_m: Array | None = None  # Reference depth in the left view, NaN = unknown.
    scene: Scene | None = None  # Surface, where a mesh or reference depth is known.
    metric: bool = (
        False  # Whether the surface is known without the imager's intrinsics (a posed mesh).
    )
    exposure: Exposure | None = None  # That the camera recorded for the first frame.
    # The left images (n, h, w) of a scene at rest, n >= 2.
    repeats: NDArray[np.uint8] | NDArray[np.uint16] | None = None

    @cached_property
    def stage(self) -> Stage:
        """The surface set up in Mitsuba: once, for that takes as long as an image of it.

        Raises:
            InputError: if there is no surface.
        """
        from starling.sim.render.mitsuba_scene import Stage

        if self.scene is None:
            raise errors.refuse(
                f"scene {self.name}",
                "must have a surface",
                "none",
                "Capture reference depth, or name its posed mesh in scene.toml.",
            )
        return Stage(self.scene)


def read(scene: CapturedScene) -> Observation:
    """Read one scene of a capture set, without its surface.

    Raises:
        InputError: whatever is wrong with the files.
    """
    frames = [scene.frame(number) for number in scene.frames]
    first = frames[0]
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
        truth_m=scene.truth_m(),
        exposure=recorded(first.record),
        repeats=np.stack(rows) if len(rows) > 1 else None,
    )


def read_all(scenes: Iterable[CapturedScene]) -> tuple[Observation, ...]:
    """Read several scenes (see `read`).

    Raises:
        InputError: if there is none, or as `read`.
    """
    observations = tuple(map(read, scenes))
    if not observations:
        raise errors.refuse("captures", "must hold a scene", "none", "Name a capture set.")
    return observations


def with_surface(
    seen: Observation, scene: CapturedScene, sensor: Sensor, *, smoothing_px: float = 0.0
) -> Observation:
    """Add to what was read of a scene what its surface is.

    A posed mesh (`scene.toml`) is taken before reference depth: it alone tells focal length and
    baseline apart.

    Args:
        seen: of the scene, as `read` has it.
        scene: of a capture set.
        sensor: that the captures are of, as far as its geometry and lens go.
        smoothing_px: see `starling.sim.scene.captured.captured_scene.load`; posed meshes have reflectance of their own.

    Raises:
        InputError: whatever is wrong with the files.
    """
    from starling.sim.scene.captured import captured_scene, known_geometry

    surface = known_geometry.load(scene, sensor)
    if surface is not None:
        return dataclasses.replace(seen, scene=surface, metric=True)
    if seen.truth_m is None or seen.left is None:
        return seen
    surface = captured_scene.load(scene.path, sensor, smoothing_px=smoothing_px)
    return dataclasses.replace(seen, scene=surface)


def load(scene: CapturedScene, sensor: Sensor, *, smoothing_px: float = 0.0) -> Observation:
    """Read one scene and what its surface is (see `read` and `with_surface`)."""
    return with_surface(read(scene), scene, sensor, smoothing_px=smoothing_px)


def load_all(scenes: Sequence[CapturedScene], sensor: Sensor) -> tuple[Observation, ...]:
    """Read several scenes and what their surfaces are (see `read_all` and `with_surface`)."""
    read = zip(read_all(scenes), scenes, strict=True)
    return tuple(with_surface(seen, scene, sensor) for seen, scene in read)


def truth_px(observation: Observation) -> Array | None:
    """Disparity (h, w) [px] that the reference depth means, NaN where unknown."""
    truth_m = observation.truth_m
    return None if truth_m is None else observation.info.disparity_px(truth_m)


def _float(image: NDArray | None) -> Array | None:
    return None if image is None else image.astype(np.float32)
