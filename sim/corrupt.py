"""What a depth camera would return for a clean depth image: infrared, depth with holes, reasons."""

from __future__ import annotations

import dataclasses
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from starling.patterns import errors
from starling.sim.arrays import Image
from starling.sim.effects import Value, setting
from starling.sim.geometry import frames
from starling.sim.reading import Reading as Reading
from starling.sim.reason import Reason
from starling.sim.render.layers import Layers
from starling.sim.scene.scene import Ambient, Body, Material, Mesh, Scene
from starling.sim.sensor import edits, presets
from starling.sim.sensor.sensor import Sensor
from starling.sim.simulate import Shot, expose, refuse_impossible
from starling.sim.stereo.depth import DepthMap
from starling.sim.stereo.post.temporal import History
from starling.sim.warp import daylight, depth_input, suspicions
from starling.sim.warp.layers import DepthScene, layers

if TYPE_CHECKING:  # Warp is an extra.
    from starling.sim.batch.batch_reading import BatchReading
    from starling.sim.batch.reading import BatchRig

_MARGIN_PX = 8  # Disparities searched beyond those of the scene [px].
_STEP_PX = 16  # Engines search a multiple of this.


@dataclass(frozen=True, slots=True, eq=False)
class LitDepth:
    """A depth image with light on its surfaces. Its frames differ in noise alone."""

    layers: Layers
    scene: Scene  # With its ambient light.
    sensor: Sensor  # Searches only the disparities of the image.
    seen: bool  # Whether there is a surface.

    def shoot(self, *, seed: int = 0, frame: int = 0, past: History | None = None) -> Shot:
        """Return a reading with noise of its own, as `starling.simulate` does."""
        shot = expose(self.layers, self.scene, self.sensor, seed=seed, frame=frame, past=past)
        return shot if self.seen else without_depth(shot, past)


class HoleModel(Protocol):
    """Model of what the physics misses."""

    def __call__(self, shot: Shot, sensor: Sensor, *, seed: int, frame: int) -> DepthMap:
        """Return the depth of a reading of the sensor, with further pixels without depth."""
        ...


class Corruptor:
    """Corrupts depth images of one camera with one sensor."""

    def __init__(
        self,
        sensor: Sensor | Path | str,
        camera_matrix: NDArray[np.floating],
        *,
        effects: Mapping[str, Value] | None = None,
        residual: HoleModel | None = None,
    ) -> None:
        """Check the camera and the effects.

        Args:
            sensor: depth camera to imitate, or its name as for `starling.load_sensor`.
            camera_matrix: (3, 3) intrinsics of the depth images [px].
            effects: strengths as for `starling.apply_effects`.
            residual: removes depth where a trained model does; from `starling.load_residual`.

        Raises:
            InputError: if the matrix is no camera matrix, or an effect needs surfaces that a depth
                image does not have. Also if the residual is no loaded model.
        """
        refuse_unloaded(residual)
        self.camera_matrix = edits.checked_matrix(camera_matrix)
        settings = setting.checked({} if effects is None else effects)
        _refuse_effects(settings)
        device = presets.resolved(sensor)
        self.sensor, self._scene = setting.apply(device, _SCENE, settings)
        refuse_impossible(self.sensor, 2)
        self._residual = residual
        self._warned: tuple[int, ...] = ()  # Size of the images that were looked at.
        self._rigs: dict[str, BatchRig] = {}  # Constants of batches, by device.

    def warm(self, shape: tuple[int, int]) -> None:
        """Compile and fill all tables, so that the first call is as fast as the others.

        Args:
            shape: (height, width) of the depth images.

        Raises:
            InputError: no height or no width.
        """
        if np.shape(shape) != (2,):
            raise errors.refuse("shape", "must be (height, width)", shape, "Give pixels.")
        for name, side in zip(("height", "width"), shape, strict=True):
            errors.whole_number(name, side, 1, 2**31, "Give pixels.")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            self(np.ones(shape, np.float32))
        self._warned = ()

    @property
    def left_from_right(self) -> frames.Pose:
        """Pose (4, 4) of the right imager, for `right_depth_m`; x right, y down, z forward."""
        return frames.right_of(np.eye(4), self.sensor.true_baseline_m)

    @property
    def left_from_projector(self) -> frames.Pose:
        """Pose (4, 4) for `projector_depth_m`: the projector's place, the left imager's axes."""
        return frames.pose(self.sensor.projector.position_m, (0.0, 0.0, 0.0))

    def __call__(
        self,
        depth_m: NDArray[np.floating],
        *,
        reflectance: float | NDArray[Any] | None = None,
        ambient_lux: float | None = None,
        up: ArrayLike | None = None,
        right_depth_m: NDArray[np.floating] | None = None,
        projector_depth_m: NDArray[np.floating] | None = None,
        seed: int = 0,
        frame: int = 0,
        past: History | None = None,
    ) -> Reading:
        """Corrupt one depth image (arguments and errors as `starling.corrupt`).

        The first image of each size is looked at for usual mistakes, with a warning for each.
        """
        lit = self.light(
            depth_m,
            reflectance=reflectance,
            ambient_lux=ambient_lux,
            up=up,
            right_depth_m=right_depth_m,
            projector_depth_m=projector_depth_m,
        )
        return self.read(lit, seed=seed, frame=frame, past=past)

    def read(
        self, lit: LitDepth, *, seed: int = 0, frame: int = 0, past: History | None = None
    ) -> Reading:
        """Return a reading of a lit depth image (see `light`), with noise of its own."""
        shot = lit.shoot(seed=seed, frame=frame, past=past)
        return reading_of(shot, self.sensor, self._residual, seed=seed, frame=frame)

    def light(
        self,
        depth_m: NDArray[np.floating],
        *,
        reflectance: float | NDArray[Any] | None = None,
        ambient_lux: float | None = None,
        up: ArrayLike | None = None,
        right_depth_m: NDArray[np.floating] | None = None,
        projector_depth_m: NDArray[np.floating] | None = None,
        empty: bool = False,
        is_along_axis: bool = False,
    ) -> LitDepth:
        """Light one depth image, whose frames differ in noise alone.

        An image without a surface in the sensor's view is refused; with `empty` all of its depth
        is missing. `is_along_axis` says that depth is no depth buffer and no range for certain.
        """
        sensor, clean = self.sensor, depth_input.checked_depth("depth_m", depth_m, empty=empty)
        camera = depth_input.InputCamera(self.camera_matrix, clean.shape)
        depth = depth_input.resampled(clean, camera, sensor)
        seen = bool(np.isfinite(depth).any())
        if not seen and not empty:
            advice = "Load the sensor with this camera_matrix."
            raise errors.refuse("depth_m", "must cover part of the sensor's image", "none", advice)
        if clean.shape != self._warned and seen:
            self._warned = clean.shape
            suspicions.warn_of_cameras(camera, sensor)
            if not is_along_axis:
                suspicions.warn_of_depth(clean, camera)
        others = [
            None
            if image is None
            else depth_input.resampled(
                depth_input.checked_depth(name, image, shape=clean.shape), camera, sensor
            )
            for name, image in (
                ("right_depth_m", right_depth_m),
                ("projector_depth_m", projector_depth_m),
            )
        ]
        reflected = depth_input.reflectance(reflectance, camera, sensor)
        scene = dataclasses.replace(
            self._scene, ambient=daylight.ambient_of(self._scene.ambient, ambient_lux, up, sensor)
        )
        rendered = layers(
            DepthScene(
                depth_m=depth,
                reflectance=np.minimum(reflected * scene.finish.reflectance_scale, np.float32(1)),
                ambient=scene.ambient,
                right_depth_m=others[0],
                projector_depth_m=others[1],
            ),
            sensor,
        )
        return LitDepth(rendered, scene, narrow_search(sensor, depth), seen)

    def batch(
        self,
        depth: Any,
        *,
        reflectance: Any = None,
        ambient_lux: Any = None,
        up: Any = None,
        right_depth_m: Any = None,
        projector_depth_m: Any = None,
        seed: int = 0,
        frame: int = 0,
    ) -> BatchReading:
        """Corrupt depth images of many environments on their device, without a copy to the host.

        All environments have the same sensor, and random numbers of their own. Memory beyond the
        results is bounded by 2 GiB or one environment (`batch.reading.SLICE_BYTES`). The first
        call compiles. Values are not checked: 0, negative numbers, NaN and infinity are no surface.

        Args:
            depth: (environments, h, w) float32 along the optical axis [m], a torch tensor or a Warp
                array. Size and camera are those of the sensor. Other arrays are on its device.
            reflectance: as in `starling.corrupt`, for all environments; arrays of the same kind
                are (environments, h, w) float32 or (environments, h, w, 3) uint8.
            ambient_lux: as in `starling.corrupt`, or an array (environments,) float32.
            up: as in `starling.corrupt`, or an array (environments, 3) float32.
            right_depth_m: (environments, h, w) float32, as in `starling.corrupt`.
            projector_depth_m: same.
            seed: as in `starling.corrupt`.
            frame: as in `starling.corrupt`.

        Raises:
            InputError: if `warp-lang` is not installed, the arrays have another shape, type or
                device, or the sensor has settings that a batch cannot imitate. Also if the
                corruptor has a residual or texture.
        """
        from starling.sim.batch import handoff, refusals

        refusals.refuse_residual(self._residual)
        refusals.refuse_texture(self._scene)

        handoff.import_warp()
        from starling.sim.batch import batch_scene, reading  # The imports need Warp.

        seed = errors.whole_number("seed", seed, 0, 2**63 - 1)
        frame = errors.whole_number("frame", frame, 0, 2**63 - 1)
        device = reading.admit(depth, self.sensor, self.camera_matrix).device
        if device.alias not in self._rigs:
            self._rigs[device.alias] = reading.build(self.sensor, self._scene, device)
        rig = self._rigs[device.alias]
        inputs = batch_scene.SceneArrays(
            reflectance=reflectance,
            ambient_lux=ambient_lux,
            up=up,
            right_depth_m=right_depth_m,
            projector_depth_m=projector_depth_m,
        )
        return reading.corrupt(depth, inputs, rig, seed=seed, frame=frame)


# The layers hold the surfaces; the body gives them a name.
_SCENE = Scene(
    name="depth image",
    ambient=Ambient(gradient=0.0),
    bodies=(
        Body(
            name="surface",
            mesh=Mesh(vertices=np.eye(3, dtype=np.float32), faces=np.array([[0, 1, 2]], np.uint32)),
            material=Material(name="surface"),
        ),
    ),
)
# Effects on the scene that act on layers of a depth image, and why others do not.
_SCENE_EFFECTS = ("ambient", "ambient_gradient", "nir_reflectance", "texture", "baseline_error")


def _refuse_effects(effects: Mapping[str, Value]) -> None:
    for name in effects:
        effect, _ = setting.parameter_of(name)
        if setting.acts_on_scene_only(name) and effect.name not in _SCENE_EFFECTS:
            raise errors.refuse(
                f"effect {name}",
                "must not need surfaces behind or beside the depth image",
                effects[name],
                "Simulate the scene itself: starling.simulate.",
            )


def refuse_unloaded(residual: object) -> None:
    """Refuse what is no model, such as the name of one.

    Raises:
        InputError: if the residual cannot be called.
    """
    if not (residual is None or callable(residual)):
        advice = "Load it: starling.load_residual(NAME)."
        raise errors.refuse("residual", "must be a loaded model", repr(residual), advice)


def reading_of(
    shot: Shot, sensor: Sensor, residual: HoleModel | None, *, seed: int, frame: int
) -> Reading:
    """Return a shot as a reading, after a model has removed depth.

    Raises:
        InputError: if the model returns no depth map.
    """
    if residual is None:
        return Reading.from_shot(shot, shot.depth, sensor)
    depth = residual(shot, sensor, seed=seed, frame=frame)
    errors.instance("result of residual", depth, DepthMap, "Return shot.depth, changed.")
    return Reading.from_shot(shot, depth, sensor)


def without_depth(shot: Shot, past: History | None) -> Shot:
    """Return a reading of no surface, without the false matches in its noise."""
    shape = shot.depth.valid.shape
    depth = DepthMap(
        disparity_px=np.full(shape, np.nan, np.float32),
        depth_m=np.full(shape, np.nan, np.float32),
        valid=np.zeros(shape, np.bool_),
        reason=np.full(shape, Reason.NO_SURFACE, np.uint32),
        history=past,
    )
    registered_m = shot.registered_m
    if registered_m is not None:
        registered_m = np.full_like(registered_m, np.nan)
    return dataclasses.replace(shot, depth=depth, registered_m=registered_m)


def narrow_search(sensor: Sensor, depth_m: Image) -> Sensor:
    """The sensor, which searches only the disparities of the scene, and 8 px beyond them."""
    known = depth_m[np.isfinite(depth_m)]
    if sensor.kind != "stereo" or sensor.matcher.extended or not known.size:
        return sensor
    matcher = sensor.matcher
    first, end = matcher.min_disparity_px, matcher.min_disparity_px + matcher.search_px
    true = sensor.fx_px * sensor.true_baseline_m
    low = max(first, int(true / known.max()) - _MARGIN_PX)
    span = true / known.min() + _MARGIN_PX - low
    # Rounded up; a search that would pass the end starts earlier, so that nothing near is lost.
    search = min(max(-(-int(np.ceil(span)) // _STEP_PX), 1) * _STEP_PX, end - first)
    narrowed = dataclasses.replace(
        matcher, min_disparity_px=min(low, end - search), search_px=search
    )
    return dataclasses.replace(sensor, matcher=narrowed)
