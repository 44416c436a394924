"""Baseline error of the sensor and placement error of the scene model.

Both errors are applied to the sensor, so that the scene's meshes stay unchanged. A moved scene
equals a sensor moved the opposite way. A scene enlarged by s equals a sensor shrunk by s, with
depth and projector light scaled after rendering.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from starling.sim.geometry import frames
from starling.sim.render.layers import Layers, ViewLayers
from starling.sim.render.mitsuba_scene import MitsubaScene
from starling.sim.scene.scene import ModelError, Scene
from starling.sim.sensor.projector import Projector
from starling.sim.sensor.sensor import Sensor


def rig_in_model(mi_scene: MitsubaScene, sensor: Sensor) -> tuple[MitsubaScene, Sensor]:
    """Express the true rig in the model's world frame and units.

    The true position of a model point p, in the left imager's frame, is s R p + t (scale s,
    rotation R, shift t). In the model's frame the imager is at -R' t / s, rotated by R', and all
    lengths of the rig are divided by s.

    Args:
        mi_scene: Scene model with its error. Its Mitsuba shapes are shared, not rebuilt.
        sensor: Sensor with its nominal geometry.

    Returns:
        Scene and sensor to render, without errors; the same objects if there are no errors.
    """
    scene, true = true_rig(mi_scene.scene, sensor)
    if scene is mi_scene.scene:
        return mi_scene, sensor
    return mi_scene.with_scene(scene), true


def true_rig(scene: Scene, sensor: Sensor) -> tuple[Scene, Sensor]:
    """As `rig_in_model`, for a scene that is not loaded in Mitsuba."""
    if scene.model_error == ModelError() and sensor.baseline_error == 0:
        return scene, sensor
    return _true_scene(scene), _true_sensor(sensor, scene.model_error.scale)


def scale_layers(layers: Layers, scene: Scene) -> Layers:
    """Scale layers rendered in the model's units to the true scale s.

    The projector's irradiance falls by 1 / s^2. Ambient light does not change. Depth grows by s.

    Args:
        layers: Layers rendered with the scene and sensor of `rig_in_model`.
        scene: Scene with its model error.
    """
    scale = scene.model_error.scale
    if scale == 1:
        return layers
    depth = layers.truth.depth_m * np.float32(scale)
    return dataclasses.replace(
        layers,
        left=_scale_view(layers.left, scale),
        right=None if layers.right is None else _scale_view(layers.right, scale),
        truth=dataclasses.replace(layers.truth, depth_m=depth),
    )


def _scale_view(view: ViewLayers, scale: float) -> ViewLayers:
    dimmed = np.float32(1 / scale**2)
    return dataclasses.replace(
        view,
        projector_direct=view.projector_direct * dimmed,
        projector_indirect=view.projector_indirect * dimmed,
        depth_m=view.depth_m * np.float32(scale),
    )


def _true_scene(scene: Scene) -> Scene:
    error = scene.model_error
    true_from_model = frames.pose(error.shift_m, error.turn_deg)
    true_from_model[:3, :3] *= error.scale
    rigid = np.linalg.inv(true_from_model)
    rigid[:3, :3] *= error.scale  # Restores the rotation; `_shrink` scales the lengths.
    projector = scene.other_projector
    return dataclasses.replace(
        scene,
        world_from_left=scene.world_from_left @ rigid,
        other_projector=_shrink(
            dataclasses.replace(projector, power_w=projector.power_w / error.scale**2), error.scale
        ),
        finish=dataclasses.replace(
            scene.finish, subsurface_m=scene.finish.subsurface_m / error.scale
        ),
        motion=dataclasses.replace(
            scene.motion, velocity_m_s=_divide(scene.motion.velocity_m_s, error.scale)
        ),
        model_error=ModelError(),
    )


def _true_sensor(sensor: Sensor, scale: float) -> Sensor:
    baseline = sensor.true_baseline_m
    part = sensor.projector
    if sensor.kind == "structured_light":  # The projector takes the right imager's position.
        part = dataclasses.replace(part, position_m=(baseline, 0.0, 0.0))
    colour = sensor.colour
    if colour:
        colour = dataclasses.replace(colour, position_m=_divide(colour.position_m, scale))
    return dataclasses.replace(
        sensor,
        baseline_m=baseline / scale,
        baseline_error=0.0,
        projector=_shrink(part, scale),
        colour=colour,
    )


def _shrink(projector: Projector, scale: float) -> Projector:
    return dataclasses.replace(
        projector,
        position_m=_divide(projector.position_m, scale),
        emitters=tuple(
            dataclasses.replace(emitter, offset_m=_divide(emitter.offset_m, scale))
            for emitter in projector.emitters
        ),
        focus_m=projector.focus_m / scale,
        defocus_mrad_m=projector.defocus_mrad_m / scale,
    )


def _divide(vector: tuple[float, float, float], scale: float) -> tuple[float, float, float]:
    x, y, z = vector
    return x / scale, y / scale, z / scale
