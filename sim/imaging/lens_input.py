"""The light that reaches one imager's lens: laser light and other light, kept separate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from starling.sim import randomness
from starling.sim.arrays import Image
from starling.sim.render.layers import ViewLayers
from starling.sim.scene.scene import Scene
from starling.sim.sensor.sensor import Sensor


@dataclass(frozen=True, kw_only=True, slots=True)
class LensInput:
    """Radiance at the lens [W m^-2 sr^-1], each (h, w)."""

    laser: Image  # The projector's light: coherent, of one wavelength.
    rest: Image  # All other light, as equivalent radiance at the laser's wavelength.


def combine_light(
    view: ViewLayers, scene: Scene, sensor: Sensor, *, seed: int, frame: int
) -> LensInput:
    """Combine a view's light layers, weighted by the strengths of the lights.

    Args:
        view: rendered layers of one imager.
        scene: supplies the strengths of ambient light and interreflection.
        sensor: supplies the projector's power and flicker.
        seed: seed of the capture.
        frame: number of the frame. Flicker is drawn per frame and is equal in both imagers.
    """
    power = np.float32(sensor.projector.power_w * _flicker(sensor.projector.flicker, seed, frame))
    laser = view.projector_direct * power
    if scene.interreflection:
        laser = laser + view.projector_indirect * np.float32(power * scene.interreflection)
    extra = view.other
    if scene.finish.subsurface_m:  # Ambient light is uniform, so spreading would not change it.
        from starling.sim.imaging.subsurface import spread  # A heavy import that only this needs.

        laser, extra = (
            spread(light, view.depth_m, view.body, scene, sensor) for light in (laser, extra)
        )
    rest = view.ambient * np.float32(scene.ambient.irradiance_w_m2) + extra
    return LensInput(laser=laser, rest=rest)


def _flicker(deviation: float, seed: int, frame: int) -> float:
    """Return one frame's power over the mean power: log-normal, so that it is never negative."""
    if deviation == 0:
        return 1.0
    variance = np.log1p(deviation**2)
    deviate = randomness.generator(seed, frame, "light", "flicker").standard_normal()
    return float(np.exp(deviate * np.sqrt(variance) - variance / 2))
