"""A captured depth scene and its simulated twin: device depth and simulated depth."""

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
from starling.sim.imaging import imager
from starling.sim.render import direct
from starling.sim.render.layers import Layers
from starling.sim.render.mitsuba_scene import MitsubaScene
from starling.sim.scene.captured import depth_surface
from starling.sim.scene.scene import Material
from starling.sim.sensor.sensor import Sensor
from starling.sim.stereo.depth import from_code, to_code
from starling.sim.stereo.measurement import measure

Array = NDArray[np.float32]

# Without infrared images the reflectance of a surface is unknown.
_GREY = Material(name="assumed", reflectance=0.5)


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class DepthTwin:
    """A captured scene and its rendering with one geometry; maps are (h, w), NaN = unknown."""

    name: str
    room: str
    info: CaptureInfo
    seed: int  # The same for all readings, so that they differ only by the sensor.
    device_px: Array  # Disparity of the device's depth, with f * b of the captures.
    truth_px: Array
    stage: MitsubaScene
    layers: Layers

    def rendered(self, sensor: Sensor) -> DepthTwin:
        """Return the same scene, rendered with another geometry."""
        return dataclasses.replace(self, layers=direct.layers(self.stage, sensor))

    def infrared(self, sensor: Sensor) -> simulate.InfraredPair:
        """Simulate the infrared images (see `starling.sim.simulate.infrared`)."""
        return simulate.infrared(self.layers, self.stage.scene, sensor, seed=self.seed)

    def matched(self, pair: simulate.InfraredPair, sensor: Sensor) -> Array:
        """Match the images and return disparity (h, w) [px] of the depth codes, NaN = no depth."""
        # A device matches all bits of its converter, not the output images.
        gained = imager.at_gain(sensor, pair.exposure)
        depth_m = measure(pair.matched_left, pair.matched_right, gained, causes={}).depth_m
        step_m = self.info.depth_unit_m
        return self.info.disparity_px(from_code(to_code(depth_m, step_m), step_m))

    def reading(self, sensor: Sensor) -> Array:
        """Simulate the sensor's disparity (h, w) [px], NaN = no depth."""
        return self.matched(self.infrared(sensor), sensor)

    def pair_with(self, expected_px: Array) -> DisparityPair:
        """Return the device's disparity paired with an expected disparity."""
        return DisparityPair(
            name=self.name,
            room=self.room,
            device_px=self.device_px,
            truth_px=self.truth_px,
            expected_px=expected_px,
            step_m=self.info.depth_unit_m,
            focal_baseline_px_m=self.info.focal_baseline_px_m,
        )


def render_twin(observation: Observation, sensor: Sensor, *, seed: int = 0) -> DepthTwin:
    """Render the surface of a captured scene.

    The surface is the posed mesh, or else the reference depth with an assumed reflectance. Light
    and pattern come from the sensor.

    Args:
        observation: scene with the device's depth, and a mesh or reference depth.
        sensor: sensor with the geometry of the captures.
        seed: random seed of the simulated readings.

    Raises:
        InputError: if the device's depth is missing, or mesh and reference depth are both missing.
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
                "Depth alone does not show its error: capture a scene of known geometry.",
            )
        truth_px = info.disparity_px(truth_m)
        stage = MitsubaScene(depth_surface.scene(observation.name, truth_px, info, _GREY))
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
