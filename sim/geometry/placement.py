"""Where sensor and scene truly stand to each other: the baseline's error and the model's.

Neither touches geometry. A scene moved and turned is the sensor moved the other way; a scene
enlarged by s is a sensor shrunk by s, whose lengths and light are enlarged afterwards.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from starling.sim.geometry import frames
from starling.sim.render.layers import Layers, View
from starling.sim.render.mitsuba_scene import Stage
from starling.sim.scene.scene import ModelError, Scene
from starling.sim.sensor.projector import Projector
from starling.sim.sensor.sensor import Sensor


def in_model(stage: Stage, sensor: Sensor) -> tuple[Stage, Sensor]:
    """Return the rig as it truly stands, in the lengths and the world of the scene's model.

    A point p of the model, in the left imager's frame, truly stands at s R p + t (scale s, turn
    R, shift t). So the imager stands at -R' t / s, turned by R', and all its lengths are over s.

    Args:
        stage: of the model; it is shared, not built again.
        sensor: as its data sheet says.

    Returns:
        Stage and sensor without these errors, to be rendered in their stead; the same objects
        where there are none.
    """
    scene, true = rig(stage.scene, sensor)
    if scene is stage.scene:
        return stage, sensor
    return stage.of(scene), true


def rig(scene: Scene, sensor: Sensor) -> tuple[Scene, Sensor]:
    """As `in_model`, of a scene that need not stand in Mitsuba."""
    if scene.model_error == ModelError() and sensor.baseline_error == 0:
        return scene, sensor
    return _scene(scene), _sensor(sensor, scene.model_error.scale)


def enlarged(layers: Layers, scene: Scene) -> Layers:
    """Turn what `in_model`'s rig saw into what the true rig sees.

    At s times the distance a projector's watt lays 1 / s^2 of the irradiance; light from the sky
    does not mind. Depths are s times as long.

    Args:
        layers: rendered with `in_model`'s stage and sensor.
        scene: with the model's error.
    """
    scale = scene.model_error.scale
    if scale == 1:
        return layers
    depth = layers.truth.depth_m * np.float32(scale)
    return dataclasses.replace(
        layers,
        left=_enlarged(layers.left, scale),
        right=None if layers.right is None else _enlarged(layers.right, scale),
        truth=dataclasses.replace(layers.truth, depth_m=depth),
    )


def _enlarged(view: View, scale: float) -> View:
    dimmed = np.float32(1 / scale**2)
    return dataclasses.replace(
        view,
        projector_direct=view.projector_direct * dimmed,
        projector_indirect=view.projector_indirect * dimmed,
        depth_m=view.depth_m * np.float32(scale),
    )


def _scene(scene: Scene) -> Scene:
    error = scene.model_error
    true_from_model = frames.pose(error.shift_m, error.turn_deg)
    true_from_model[:3, :3] *= error.scale
    rigid = np.linalg.inv(true_from_model)
    rigid[:3, :3] *= error.scale  # The rig keeps its angles; its lengths are `_shrunk`.
    other = scene.other_projector
    return dataclasses.replace(
        scene,
        world_from_left=scene.world_from_left @ rigid,
        other_projector=_shrunk(
            dataclasses.replace(other, power_w=other.power_w / error.scale**2), error.scale
        ),
        finish=dataclasses.replace(
            scene.finish, subsurface_m=scene.finish.subsurface_m / error.scale
        ),
        motion=dataclasses.replace(
            scene.motion, velocity_m_s=_over(scene.motion.velocity_m_s, error.scale)
        ),
        model_error=ModelError(),
    )


def _sensor(sensor: Sensor, scale: float) -> Sensor:
    baseline = sensor.baseline_m * (1 + sensor.baseline_error)
    part = sensor.projector
    if sensor.kind == "structured_light":  # The projector stands where the baseline ends.
        part = dataclasses.replace(part, position_m=(baseline, 0.0, 0.0))
    colour = sensor.colour
    if colour:
        colour = dataclasses.replace(colour, position_m=_over(colour.position_m, scale))
    return dataclasses.replace(
        sensor,
        baseline_m=baseline / scale,
        baseline_error=0.0,
        projector=_shrunk(part, scale),
        colour=colour,
    )


def _shrunk(projector: Projector, scale: float) -> Projector:
    return dataclasses.replace(
        projector,
        position_m=_over(projector.position_m, scale),
        emitters=tuple(
            dataclasses.replace(emitter, offset_m=_over(emitter.offset_m, scale))
            for emitter in projector.emitters
        ),
        focus_m=projector.focus_m / scale,
        defocus_mrad_m=projector.defocus_mrad_m / scale,
    )


def _over(vector: tuple[float, float, float], scale: float) -> tuple[float, float, float]:
    x, y, z = vector
    return x / scale, y / scale, z / scale
