"""The image of each light of a scene separately; their sum is the pixel's signal."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Literal

import numpy as np

from starling.sim.arrays import Image
from starling.sim.imaging.lens_input import LensInput, combine_light
from starling.sim.imaging.optics import image
from starling.sim.imaging.texture import textured
from starling.sim.render.layers import ViewLayers
from starling.sim.scene.scene import Scene
from starling.sim.sensor.sensor import Sensor


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Signals:
    """Radiances after `starling.sim.imaging.optics.image` [W m^-2 sr^-1], each (h, w)."""

    laser: Image  # Light of the sensor's projector.
    ambient: Image  # Ambient light of 1 W m^-2.
    other: Image  # Sun and other projectors.


def signals(
    view: ViewLayers, scene: Scene, sensor: Sensor, side: Literal["left", "right"]
) -> Signals:
    """Take a view's layers through the optics, light by light.

    Args:
        view: layers of one imager, rendered with this sensor's geometry and projector.
        scene: the rendered scene. Its interreflection applies; its ambient irradiance does not.
        sensor: its projector and optics apply.
        side: which imager.
    """
    dark = dataclasses.replace(scene.ambient, irradiance_w_m2=0.0)
    view = textured(view, scene, sensor, side)
    light = combine_light(view, dataclasses.replace(scene, ambient=dark), sensor, seed=0, frame=0)
    none = np.zeros_like(view.ambient)

    def formed(laser: Image, rest: Image) -> Image:
        if not (laser.any() or rest.any()):
            return none
        parts = LensInput(laser=laser, rest=rest)
        return image.image(parts, view.depth_m, sensor, side, seed=0)

    return Signals(
        laser=formed(light.laser, none),
        ambient=formed(none, view.ambient),
        other=formed(none, light.rest),
    )
