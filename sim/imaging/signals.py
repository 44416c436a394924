"""The image that each light of a scene makes by itself; a pixel gets the sum of them."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Literal

import numpy as np

from starling.sim.imaging.lens_input import Received, received
from starling.sim.imaging.optics import image
from starling.sim.render.layers import Image, View
from starling.sim.scene.scene import Scene
from starling.sim.sensor.sensor import Sensor


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Signals:
    """Radiances as `starling.sim.imaging.optics.image` has them [W m^-2 sr^-1], each (h, w)."""

    laser: Image  # Of the sensor's projector.
    ambient: Image  # Of ambient light of 1 W m^-2.
    other: Image  # Sun and other projectors.


def signals(
    view: View, scene: Scene, sensor: Sensor, side: Literal["left", "right"], *, seed: int = 0
) -> Signals:
    """Take a view's layers through the optics, light by light.

    Args:
        view: of one imager, rendered with this sensor's geometry and projector.
        scene: it is of; its interreflection counts, the strength of its ambient light does not.
        sensor: whose projector and optics act.
        side: which imager.
        seed: of speckle and flicker.
    """
    dark = dataclasses.replace(scene.ambient, irradiance_w_m2=0.0)
    light = received(view, dataclasses.replace(scene, ambient=dark), sensor, seed=seed, frame=0)
    none = np.zeros_like(view.ambient)

    def formed(laser: Image, rest: Image) -> Image:
        if not (laser.any() or rest.any()):
            return none
        parts = Received(laser=laser, rest=rest)
        return image.image(parts, view.depth_m, sensor, side, seed=seed)

    return Signals(
        laser=formed(light.laser, none),
        ambient=formed(none, view.ambient),
        other=formed(none, light.rest),
    )
