"""The light that reaches one imager, laser light apart from the rest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sim.layers import Image, View
from sim.scene import Scene
from sim.sensor import Sensor


@dataclass(frozen=True, kw_only=True, slots=True)
class Received:
    """Radiance at the lens [W m^-2 sr^-1], each (h, w)."""

    laser: Image  # The projector's light: coherent, of one wavelength.
    rest: Image  # Everything else, counted at the laser's wavelength.


def received(view: View, scene: Scene, sensor: Sensor, *, seed: int, frame: int) -> Received:
    """Weigh a view's layers by the strengths of their lights.

    Args:
        view: of one imager, as rendered.
        scene: whose ambient light and interreflection count.
        sensor: whose projector counts.
        seed: of the capture.
        frame: number in the capture.
    """
    power = np.float32(sensor.projector.power_w)
    laser = view.projector_direct * power
    if scene.interreflection:
        laser = laser + view.projector_indirect * np.float32(power * scene.interreflection)
    rest = view.ambient * np.float32(scene.ambient.irradiance_w_m2) + view.other
    return Received(laser=laser, rest=rest)
