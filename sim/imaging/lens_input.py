"""The light that reaches one imager, laser light apart from the rest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from starling.sim import randomness
from starling.sim.render.layers import Image, View
from starling.sim.scene.scene import Scene
from starling.sim.sensor.sensor import Sensor


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
        frame: number in the capture; in each the projector flickers anew, for both imagers alike.
    """
    power = np.float32(sensor.projector.power_w * _flicker(sensor.projector.flicker, seed, frame))
    laser = view.projector_direct * power
    if scene.interreflection:
        laser = laser + view.projector_indirect * np.float32(power * scene.interreflection)
    other = view.other
    if scene.finish.subsurface_m:  # Ambient light is even: spreading would change nothing in it.
        from starling.sim.imaging.subsurface import spread  # Loads what only this needs.

        laser, other = (
            spread(light, view.depth_m, view.body, scene, sensor) for light in (laser, other)
        )
    rest = view.ambient * np.float32(scene.ambient.irradiance_w_m2) + other
    return Received(laser=laser, rest=rest)


def _flicker(deviation: float, seed: int, frame: int) -> float:
    """Power of one frame over its mean: log-normal, as a power is never negative."""
    if deviation == 0:
        return 1.0
    variance = np.log1p(deviation**2)
    deviate = randomness.generator(seed, frame, "light", "flicker").standard_normal()
    return float(np.exp(deviate * np.sqrt(variance) - variance / 2))
