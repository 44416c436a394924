"""Expected infrared images: without noise, speckle and flicker."""

from __future__ import annotations

import dataclasses

import numpy as np

from starling.sim import simulate
from starling.sim.arrays import Image
from starling.sim.imaging.imager import Infrared
from starling.sim.render.layers import Layers
from starling.sim.scene.scene import Scene
from starling.sim.sensor.sensor import Imager, Sensor
from starling.sim.simulate import Side

_BITS = 16  # Bit depth at which quantisation is negligible.


def noiseless(layers: Layers, scene: Scene, sensor: Sensor) -> dict[Side, Image]:
    """Take rendered layers through optics and imagers without noise, speckle and flicker.

    All scenes of one seed share one draw of speckle and flicker. It would appear as the same
    deviation in every comparison with such images.

    Args:
        layers: layers of the scene, rendered with this sensor.
        scene: the rendered scene.
        sensor: its optics, crosstalk, averaging, gamma and range apply.

    Returns:
        (h, w) by view, above the black level [DN].
    """
    quiet = dataclasses.replace(
        sensor,
        projector=sensor.projector.steady(),
        left=_quiet(sensor.left),
        right=_quiet(sensor.right),
    )
    pair = simulate.infrared(layers, scene, quiet)
    images: dict[Side, Image] = {"left": _above_black(pair.left, sensor.left)}
    if pair.right is not None:
        images["right"] = _above_black(pair.right, sensor.right)
    return images


def _quiet(imager: Imager) -> Imager:
    ceiling_dn = 2.0**_BITS - 1
    return dataclasses.replace(
        imager,
        shot_noise=0.0,
        read_noise_e=0.0,
        prnu=0.0,
        pattern_contrast=0.0,
        dsnu_e=0.0,
        dark_current_e_s=0.0,
        row_noise_e=0.0,
        column_noise_e=0.0,
        hot_pixels=0.0,
        bit_depth=_BITS,
        black_level_dn=imager.black_level_dn * ceiling_dn / imager.ceiling_dn,
    )


def _above_black(codes: Infrared, imager: Imager) -> Image:
    scale = np.float32(imager.ceiling_dn / (2**_BITS - 1))
    return np.asarray(codes * scale - np.float32(imager.black_level_dn), np.float32)
