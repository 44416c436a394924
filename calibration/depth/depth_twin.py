"""One captured scene beside its simulation: what the device read, and what a sensor would read."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from starling.calibration.depth.disparity_scale import DisparityPair
from starling.calibration.observation import Observation
from starling.patterns import errors
from starling.sim import simulate
from starling.sim.captures.info import CaptureInfo
from starling.sim.render import direct
from starling.sim.render.layers import Layers
from starling.sim.render.mitsuba_scene import Stage
from starling.sim.scene.captured import depth_surface
from starling.sim.scene.scene import Material
from starling.sim.sensor.sensor import Sensor
from starling.sim.stereo.depth import from_code, to_code
from starling.sim.stereo.measurement import measure

Array = NDArray[np.float32]

# Without infrared nobody knows a surface's reflectance.
_GREY = Material(name="assumed", reflectance=0.5)


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
        return dataclasses.replace(self, layers=direct.layers(self.stage, sensor))

    def infrared(self, sensor: Sensor) -> simulate.Pair:
        """Return the images (see `starling.sim.simulate.infrared`)."""
        return simulate.infrared(self.layers, self.stage.scene, sensor, seed=self.seed)

    def matched(self, pair: simulate.Pair, sensor: Sensor) -> Array:
        """Disparity (h, w) [px] that the sensor's depth codes mean, NaN = no depth."""
        # Not by the images put out: a device matches all bits of its converter.
        depth_m = measure(pair.matched_left, pair.matched_right, sensor, causes={}).depth_m
        step_m = self.info.depth_unit_m
        return self.info.disparity_px(from_code(to_code(depth_m, step_m), step_m))

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
    if observation.scene is not None and observation.metric:
        stage = observation.stage
    else:
        if truth_m is None:
            raise errors.refuse(
                f"scene {observation.name}",
                "must have truth.png or a mesh in scene.toml",
                "neither",
                "Depth alone does not show how far off it is: capture a scene of known geometry.",
            )
        truth_px = info.disparity_px(truth_m)
        stage = Stage(depth_surface.scene(observation.name, truth_px, info, _GREY))
    layers = direct.layers(stage, sensor)
    return DepthTwin(
        name=observation.name,
        room=observation.room,
        info=info,
        seed=seed,
        device_px=info.disparity_px(observation.depth_m),
        truth_px=info.disparity_px(layers.truth.depth_m if truth_m is None else truth_m),
        stage=stage,
        layers=layers,
    )
