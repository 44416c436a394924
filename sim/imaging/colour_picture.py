"""The colour camera's picture: three monochrome renders with visible reflectances."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from starling.patterns import errors
from starling.sim.arrays import Image
from starling.sim.geometry import frames, placement
from starling.sim.geometry.pinhole import Pinhole
from starling.sim.render import direct
from starling.sim.render.mitsuba_scene import MitsubaScene
from starling.sim.scene import visible
from starling.sim.scene.scene import Scene
from starling.sim.sensor.projector import Projector
from starling.sim.sensor.sensor import Colour, Sensor

_LINEAR_END = 0.0031308  # The sRGB curve is linear below this value (IEC 61966-2-1).


def picture(scene: Scene, sensor: Sensor) -> NDArray[np.uint8]:
    """Render what the colour camera sees of a scene under its ambient light and sun.

    Ambient light and sun are assumed white. The projector is invisible, because the camera's
    filter blocks near infrared. A body without `colour` keeps its texture, tinted by its material's
    `rgb`. There is no noise; the exposure brings the mean luminance to `colour.level`.

    Args:
        scene: materials without visible reflectances (`rgb`) are grey.
        sensor: sensor with a colour camera.

    Returns:
        (h, w, 3) red, green, blue in sRGB.

    Raises:
        InputError: if the sensor has no colour camera.
    """
    scene, sensor = placement.true_rig(scene, sensor)
    if sensor.colour is None:
        raise errors.refuse(
            "colour",
            "must be given",
            f"none in {sensor.name}",
            "Add a [colour] table to the sensor.",
        )
    colour = sensor.colour
    camera = _as_imager(sensor, colour)
    pose = scene.world_from_left @ frames.pose(colour.position_m, colour.rotation_deg)
    scene = dataclasses.replace(scene, world_from_left=pose)
    # Without any material colour the scene is grey, and one render serves all three channels.
    coloured = any(visible.is_coloured(body) for body in scene.bodies)
    channels = [_channel(_visible(scene, index), camera) for index in range(3 if coloured else 1)]
    linear = np.stack(channels if coloured else 3 * channels, axis=-1)
    return encoded(linear, colour.level)


def _as_imager(sensor: Sensor, colour: Colour) -> Sensor:
    """Return a sensor whose left imager is the colour camera, without projector."""
    return dataclasses.replace(
        sensor,
        kind="stereo",
        projector=Projector(power_w=0.0),
        colour=None,
        **dataclasses.asdict(Pinhole.from_camera(colour)),
    )


def _visible(scene: Scene, index: int) -> Scene:
    """Return the scene with the reflectances of one colour channel."""
    return dataclasses.replace(
        visible.in_channel(scene, index),
        finish=dataclasses.replace(scene.finish, reflectance_scale=1.0),
        other_projector=Projector(power_w=0.0),
    )


def _channel(scene: Scene, camera: Sensor) -> Image:
    seen = direct.view(MitsubaScene(scene), camera)
    ambient = np.float32(scene.ambient.irradiance_w_m2)
    return seen.ambient * ambient + seen.other


def encoded(linear: NDArray[np.float32], level: float) -> NDArray[np.uint8]:
    """Expose linear light (h, w, 3) to a mean luminance near `level`, and encode it in sRGB."""
    # The encoded mean is then near `level`, because the sRGB curve is close to a square root.
    gain = level**2 / max(float((linear @ visible.LUMINANCE).mean()), 1e-30)
    exposed = np.clip(linear * np.float32(gain), 0, 1)
    levels = np.where(exposed <= _LINEAR_END, 12.92 * exposed, 1.055 * exposed ** (1 / 2.4) - 0.055)
    return np.rint(255 * levels).astype(np.uint8)
