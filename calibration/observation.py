"""The input of a fit: the images of one captured scene and its surface."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from starling.patterns import errors
from starling.sim.captures.capture import CapturedScene
from starling.sim.captures.info import CaptureInfo
from starling.sim.captures.png import GreyImage
from starling.sim.imaging.imager.exposure import Exposure, read_exposure
from starling.sim.on_demand import OnDemand
from starling.sim.scene.scene import Scene
from starling.sim.sensor.sensor import Sensor

if TYPE_CHECKING:  # Loads the renderer, which takes seconds.
    from starling.sim.render.mitsuba_scene import MitsubaScene

Array = NDArray[np.float32]
Side = Literal["left", "right"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Observation:
    """One captured scene: the first frame's images, each (h, w), or None if missing."""

    name: str
    room: str  # Rooms, not single scenes, are held out.
    info: CaptureInfo  # Camera geometry from capture.toml.
    left: Array | None = None  # [DN], including the black level.
    right: Array | None = None
    left_off: Array | None = None  # Projector off.
    right_off: Array | None = None
    depth_m: Array | None = None  # Depth from the device, NaN = no depth.
    truth_m: Array | None = None  # Reference depth in the left view, NaN = unknown.
    scene: Scene | None = None  # Surface, from a posed mesh or from reference depth.
    # Whether the surface is independent of the imager's intrinsics (a posed mesh).
    metric: bool = False
    exposure: Exposure | None = None  # Recorded by the camera for the first frame.
    # Left images of a static scene, two or more; read when they are used.
    repeats: Sequence[GreyImage] | None = None

    @cached_property
    def stage(self) -> MitsubaScene:
        """The surface as a Mitsuba scene. It is cached, because it costs as much as an image.

        Raises:
            InputError: if there is no surface.
        """
        from starling.sim.render.mitsuba_scene import MitsubaScene

        if self.scene is None:
            raise errors.refuse(
                f"scene {self.name}",
                "must have a surface",
                "none",
                "Capture reference depth, or name its posed mesh in scene.toml.",
            )
        return MitsubaScene(self.scene)


def read(scene: CapturedScene) -> Observation:
    """Read one scene of a capture set, without its surface.

    Raises:
        InputError: if a file is invalid.
    """
    first = scene.frame(scene.frames[0])
    still = [
        number
        for number in scene.frames
        if scene.record(number).get("counts", "repeats") == "repeats"
        and scene.ir_left(number) is not None
    ]
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
        exposure=read_exposure(first.record),
        repeats=OnDemand(still, partial(_left, scene)) if len(still) > 1 else None,
    )


def _left(scene: CapturedScene, number: int) -> GreyImage:
    image = scene.ir_left(number)
    assert image is not None  # `read` lists frames with this image.
    return image


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
    observation: Observation, scene: CapturedScene, sensor: Sensor, *, smoothing_px: float = 0.0
) -> Observation:
    """Add the surface to an observation.

    A posed mesh (`scene.toml`) takes precedence over reference depth, because only a mesh
    separates focal length from baseline.

    Args:
        observation: of the scene, as `read` has it.
        scene: scene of a capture set.
        sensor: sensor with the geometry and lens of the captures.
        smoothing_px: see `starling.sim.scene.captured.captured_scene.load`. Posed meshes do not
            use it, because they define their reflectance.

    Raises:
        InputError: if a file is invalid.
    """
    from starling.sim.scene import visible
    from starling.sim.scene.captured import captured_scene, known_geometry

    surface = known_geometry.load(scene, sensor)
    if surface is not None:
        surface = visible.in_band(surface, sensor)
        return dataclasses.replace(observation, scene=surface, metric=True)
    if observation.truth_m is None or observation.left is None:
        return observation
    surface = captured_scene.load(scene.path, sensor, smoothing_px=smoothing_px)
    return dataclasses.replace(observation, scene=surface)


def load(scene: CapturedScene, sensor: Sensor, *, smoothing_px: float = 0.0) -> Observation:
    """Read one scene and its surface (see `read` and `with_surface`)."""
    return with_surface(read(scene), scene, sensor, smoothing_px=smoothing_px)


def truth_px(observation: Observation) -> Array | None:
    """Convert the reference depth to disparity (h, w) [px], NaN where unknown."""
    reference_m = observation.truth_m
    return None if reference_m is None else observation.info.disparity_px(reference_m)


def _float(image: NDArray | None) -> Array | None:
    return None if image is None else image.astype(np.float32)
