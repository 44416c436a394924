"""One captured scene beside its simulation: what the device read, and what a sensor would read."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.depth.disparity_scale import DisparityPair
from calibration.observation import Observation
from patterns import errors
from sim import render, simulate
from sim.capture_info import CaptureInfo
from sim.depth import disparity_from_depth, from_code, measure, to_code
from sim.layers import Layers
from sim.scene import Ambient, Body, Material, Scene
from sim.scenes import depth_mesh
from sim.sensor import Sensor
from sim.stage import Stage

Array = NDArray[np.float32]

_REFLECTANCE = 0.5  # Assumed all over: without infrared nobody knows it.
_AMBIENT_W_M2 = 0.4  # As `sim.scenes.captured` assumes of lit rooms.
_MARGIN_PX = 128  # Beyond the image, for what only the right imager sees.
_PATCHED_PX = 8.0  # What continues from different places is joined up to this step.
_NOISY_SURFACE = 0.01  # Shadow tolerance of surfaces measured with noise.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class DepthTwin:
    """A captured scene and its rendering by one geometry; maps are (h, w), NaN where unknown."""

    name: str
    room: str
    info: CaptureInfo
    seed: int  # Common to all readings, so that they differ by the sensor alone.
    device_px: Array  # Disparity that the device's depth means, by the captures' f b.
    truth_px: Array
    stage: Stage
    layers: Layers

    def rendered(self, sensor: Sensor) -> DepthTwin:
        """Return the same scene as another geometry sees it."""
        return dataclasses.replace(self, layers=render.layers(self.stage, sensor))

    def infrared(self, sensor: Sensor) -> simulate.Pair:
        """Return the images (see `sim.simulate.infrared`)."""
        return simulate.infrared(self.layers, self.stage.scene, sensor, seed=self.seed)

    def matched(self, pair: simulate.Pair, sensor: Sensor) -> Array:
        """Disparity (h, w) [px] that the sensor's depth codes mean, NaN = no depth."""
        depth_m = measure(pair.left, pair.right, sensor, causes={}).depth_m
        step_m = self.info.depth_unit_m
        return _disparity(from_code(to_code(depth_m, step_m), step_m), self.info)

    def reading(self, sensor: Sensor) -> Array:
        """Disparity (h, w) [px] that the sensor reads, NaN = no depth."""
        return self.matched(self.infrared(sensor), sensor)

    def beside(self, expected_px: Array) -> DisparityPair:
        """Return the device's disparities beside those that a sensor reads."""
        return DisparityPair(
            name=self.name,
            room=self.room,
            device_px=self.device_px,
            truth_px=self.truth_px,
            expected_px=expected_px,
            step_m=self.info.depth_unit_m,
            focal_baseline_px_m=self.info.focal_baseline_px_m,
        )


def twin(observation: Observation, sensor: Sensor, *, seed: int = 0) -> DepthTwin:
    """Render what a scene's captures are of.

    The surface is the posed mesh where there is one, else the reference depth under an assumed
    reflectance: light and pattern are the sensor's own, not the scene's.

    Args:
        observation: with the device's depth, and a mesh or reference depth.
        sensor: of the captures' geometry.
        seed: of its readings.

    Raises:
        InputError: if the device's depth is missing, or both mesh and reference depth are.
    """
    if observation.depth_m is None:
        raise errors.refuse(
            f"scene {observation.name}",
            "must hold depth.png",
            "none",
            "Save the device's depth, or calibrate from infrared.",
        )
    info, truth_m = observation.info, observation.truth_m
    scene = observation.scene if observation.metric else None
    if scene is None:
        if truth_m is None:
            raise errors.refuse(
                f"scene {observation.name}",
                "must have truth.png or a mesh in scene.toml",
                "neither",
                "Depth alone does not show how far off it is: capture a scene of known geometry.",
            )
        scene = surface(_disparity(truth_m, info), info, observation.name)
    stage = Stage(scene)
    layers = render.layers(stage, sensor)
    return DepthTwin(
        name=observation.name,
        room=observation.room,
        info=info,
        seed=seed,
        device_px=_disparity(observation.depth_m, info),
        truth_px=_disparity(layers.truth.depth_m if truth_m is None else truth_m, info),
        stage=stage,
        layers=layers,
    )


def surface(truth_px: Array, info: CaptureInfo, name: str) -> Scene:
    """Turn reference depth into a scene of one grey: closed, smoothed, going on behind edges.

    Args:
        truth_px: disparity (h, w) [px] by the captures' own f b, NaN where unknown.
        info: of the captures.
        name: of the scene.
    """
    seen = depth_mesh.smoothed(depth_mesh.closed(truth_px))
    wide = np.pad(seen, ((0, 0), (_MARGIN_PX, _MARGIN_PX)), mode="edge")
    intrinsics = np.array(
        [[info.fx_px, 0, info.cx_px + _MARGIN_PX], [0, info.fy_px, info.cy_px], [0, 0, 1]]
    )
    hidden, _ = depth_mesh.behind(wide)
    grey = Material(name="assumed", reflectance=_REFLECTANCE)
    parts = [("surface", wide, {}), ("surface behind", hidden, {"jump_px": _PATCHED_PX})]
    bodies = tuple(
        Body(
            name=part,
            mesh=depth_mesh.triangles(disparity, intrinsics, info.focal_baseline_px_m, **limit),
            material=grey,
        )
        for part, disparity, limit in parts
        if np.isfinite(disparity).any()
    )
    return Scene(
        name=name,
        bodies=bodies,
        ambient=Ambient(irradiance_w_m2=_AMBIENT_W_M2, gradient=0.0),
        shadow_tolerance=_NOISY_SURFACE,
    )


def _disparity(depth_m: Array, info: CaptureInfo) -> Array:
    return disparity_from_depth(depth_m, focal_px=info.fx_px, baseline_m=info.baseline_m)
