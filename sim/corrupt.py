"""What a depth camera would return for a clean depth image: infrared, depth with holes, reasons."""

from __future__ import annotations

import dataclasses
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from starling.patterns import errors
from starling.sim.arrays import Image, Labels, Mask
from starling.sim.effects import Value, setting
from starling.sim.geometry import frames
from starling.sim.imaging.imager import Infrared
from starling.sim.reason import Reason
from starling.sim.scene.scene import Ambient, Body, Material, Mesh, Scene
from starling.sim.sensor import edits, presets
from starling.sim.sensor.sensor import Sensor
from starling.sim.simulate import Shot, expose, refuse_impossible
from starling.sim.stereo.depth import DepthMap, disparity_from_depth, to_code
from starling.sim.stereo.post.temporal import History
from starling.sim.stereo.semiglobal import Band
from starling.sim.warp import depth_input, suspicions
from starling.sim.warp.layers import DepthScene, layers

# Daylight in the imager's band [W m^-2 / lux], for an assumed band of 50 nm. ASTM G173 (AM1.5
# global) has 0.89 W m^-2 nm^-1 at 850 nm, and 109 klux.
W_M2_PER_LUX = 0.89 * 50 / 109e3
_MARGIN_PX = 8  # Disparities searched beyond those of the scene [px].
_STEP_PX = 16  # Engines search a multiple of this.
_BAND_ROWS = 96  # Rows that share a search.
_BAND_MARGIN = 12  # Rows above and below a band that its windows reach.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Reading:
    """One reading of a depth camera, each image (h, w) of the sensor's size."""

    ir_left: Infrared
    ir_right: Infrared | None  # None: structured light.
    depth_m: Image  # NaN where missing.
    depth_u16: NDArray[np.uint16]  # Code as the device writes it; 0 where missing.
    reason: Labels  # Codes of `starling.Reason`; 0 if and only if there is depth.
    lit: Mask  # The projector reaches the surface.
    right_sees: Mask  # The right imager sees the surface.
    true_depth_m: Image  # The input in the sensor's camera; NaN without a surface.
    exposure_s: float
    gain: float
    history: History | None  # Pass as `past` with the next frame, for a temporal filter.


class Corruptor:
    """Corrupts depth images of one camera with one sensor."""

    def __init__(
        self,
        sensor: Sensor | Path | str,
        camera_matrix: NDArray[np.floating],
        *,
        effects: Mapping[str, Value] | None = None,
    ) -> None:
        """Check the camera and the effects.

        Args:
            sensor: depth camera to imitate, or its name as for `starling.load_sensor`.
            camera_matrix: (3, 3) intrinsics of the depth images [px].
            effects: strengths as for `starling.apply_effects`.

        Raises:
            InputError: if the matrix is no camera matrix, or an effect needs surfaces that a depth
                image does not have.
        """
        self.camera_matrix = edits.checked_matrix(camera_matrix)
        settings = setting.checked({} if effects is None else effects)
        _refuse_effects(settings)
        device = presets.resolved(sensor)
        self.sensor, self._scene = setting.apply(device, _SCENE, settings)
        refuse_impossible(self.sensor, 2)
        self._warned: tuple[int, ...] = ()  # Size of the images that were looked at.

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
        right_depth_m: NDArray[np.floating] | None = None,
        projector_depth_m: NDArray[np.floating] | None = None,
        seed: int = 0,
        frame: int = 0,
        past: History | None = None,
    ) -> Reading:
        """Corrupt one depth image (arguments and errors as `starling.corrupt`).

        The first image of each size is looked at for usual mistakes, with a warning for each.
        """
        shot = self.shoot(
            depth_m,
            reflectance=reflectance,
            ambient_lux=ambient_lux,
            right_depth_m=right_depth_m,
            projector_depth_m=projector_depth_m,
            seed=seed,
            frame=frame,
            past=past,
        )
        truth = shot.layers.truth
        return Reading(
            ir_left=shot.ir_left,
            ir_right=shot.ir_right,
            depth_m=shot.depth.depth_m,
            depth_u16=to_code(shot.depth.depth_m, self.sensor.post.depth_unit_m),
            reason=shot.depth.reason,
            lit=truth.lit,
            right_sees=truth.right_sees,
            true_depth_m=truth.depth_m,
            exposure_s=shot.exposure_s,
            gain=shot.gain,
            history=shot.depth.history,
        )

    def shoot(
        self,
        depth_m: NDArray[np.floating],
        *,
        reflectance: float | NDArray[Any] | None = None,
        ambient_lux: float | None = None,
        right_depth_m: NDArray[np.floating] | None = None,
        projector_depth_m: NDArray[np.floating] | None = None,
        seed: int = 0,
        frame: int = 0,
        past: History | None = None,
        empty: bool = False,
    ) -> Shot:
        """Corrupt one depth image, as `starling.simulate` returns a reading: with all layers.

        An image without a surface is refused; with `empty` all of its depth is missing.
        """
        sensor, clean = self.sensor, depth_input.checked_depth("depth_m", depth_m, empty=empty)
        camera = depth_input.DepthCamera(self.camera_matrix, clean.shape)
        if clean.shape != self._warned and np.isfinite(clean).any():
            self._warned = clean.shape
            suspicions.warn_of_cameras(camera, sensor)
            suspicions.warn_of_depth(clean, camera)
        depth = depth_input.resampled(clean, camera, sensor)
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
        scene = self._scene if ambient_lux is None else _lit_by(self._scene, ambient_lux)
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
        device, bands = _search(sensor, depth)
        shot = expose(rendered, scene, device, seed=seed, frame=frame, past=past, bands=bands)
        return shot if np.isfinite(clean).any() else _without_depth(shot, past)


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
_SCENE_EFFECTS = ("ambient", "ambient_gradient", "nir_reflectance", "baseline_error")


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


def _without_depth(shot: Shot, past: History | None) -> Shot:
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


def _lit_by(scene: Scene, lux: float) -> Scene:
    errors.in_interval("ambient_lux", lux, 0.0, 2e5, "Direct sunlight has 1e5 lux.")
    ambient = dataclasses.replace(scene.ambient, irradiance_w_m2=lux * W_M2_PER_LUX)
    return dataclasses.replace(scene, ambient=ambient)


def _search(sensor: Sensor, depth_m: Image) -> tuple[Sensor, list[Band]]:
    """Limit the search to the scene's disparities and 8 px beyond them, and that of each band."""
    matcher = sensor.matcher
    end = matcher.min_disparity_px + matcher.search_px
    disparity = disparity_from_depth(
        depth_m, focal_px=sensor.fx_px, baseline_m=sensor.true_baseline_m
    )
    whole = _range(disparity, matcher.min_disparity_px, end)
    if sensor.kind != "stereo" or whole is None:
        return sensor, []
    low, count = whole
    narrowed = dataclasses.replace(matcher, min_disparity_px=low, search_px=count)
    bands = []
    for start in range(0, sensor.height, _BAND_ROWS):
        stop = min(start + _BAND_ROWS, sensor.height)
        rows = disparity[max(start - _BAND_MARGIN, 0) : stop + _BAND_MARGIN]
        first, searched = _range(rows, low, low + count) or whole
        bands.append(Band(start, stop, first - low, searched))
    return dataclasses.replace(sensor, matcher=narrowed), bands


def _range(disparity: Image, first: int, end: int) -> tuple[int, int] | None:
    """First disparity and number of disparities for these, in [first, end); None without any."""
    least, most = np.fmin.reduce(disparity, axis=None), np.fmax.reduce(disparity, axis=None)
    if not np.isfinite(least):
        return None
    low = min(max(first, int(least) - _MARGIN_PX), end - _STEP_PX)
    span = float(most) + _MARGIN_PX - low
    search = min(max(-(-int(np.ceil(span)) // _STEP_PX), 1) * _STEP_PX, end - low)
    return low, search - search % _STEP_PX
