"""Images without what is drawn by lot."""

from __future__ import annotations

import numpy as np

from diagnosis.ground import Image
from sim import sensor_edits, simulate
from sim.layers import Layers
from sim.scene import Scene
from sim.sensor import Sensor

STILL = (  # What an image has beside its scene, at its neutral.
    ("imager.shot_noise", 0.0),
    ("imager.read_noise_e", 0.0),
    ("imager.prnu", 0.0),
    ("imager.dsnu_e", 0.0),
    ("projector.speckle_contrast", 0.0),
)


def expected(layers: Layers, scene: Scene, sensor: Sensor) -> Image:
    """Left image (h, w) above the black level [DN], which pixels are parted by.

    Speckle and flicker have one draw for all scenes of a seed: bins and residuals would show it in
    every one.

    Args:
        layers: what was rendered of the scene.
        scene: as simulated.
        sensor: the base.
    """
    still = sensor_edits.with_values(sensor, (*STILL, ("projector.flicker", 0.0)))
    found = simulate.infrared(layers, scene, still).electrons
    return found * np.float32(sensor.left.dn_per_electron)
