"""What a fit of levels says that each captured image should be."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from starling.calibration.least_squares import tiles
from starling.calibration.photometry import light_model, weights
from starling.calibration.photometry.levels import Side
from starling.calibration.photometry.light_model import Formed, Image
from starling.sim.render.layers import Mask
from starling.sim.sensor.sensor import Sensor

Array = NDArray[np.float32]


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Prediction:
    """What a fit says one image should be (h, w)."""

    scene: str
    side: Side
    on: bool
    level_dn: Array  # Captured, black level included.
    signal_dn: Array  # Predicted, of light alone.
    sharp_laser_dn: Array  # The laser's part of it, before crosstalk and averaging.
    residual_dn: Array
    used: Mask
    dots: bool  # Whether dots are where they were predicted, so that residuals mean something.


def predict(
    image: Image,
    values: Mapping[str, float],
    sensor: Sensor,
    formed: Formed,
    *,
    reflectance_free: bool,
    dots: bool,
) -> Prediction:
    """Predict an image; with `reflectance_free`, each tile's factor and gradient are fitted."""
    column = light_model.columns(image, values, sensor, (), formed)
    signal = light_model.above_black(image, values, sensor)
    factor: Array | np.float32 = np.float32(1)
    if reflectance_free:
        rough = weights.tile_factor(image, signal, column.model)
        factor = tiles.fitted_factor(signal, column.model, weights.weight(image, column, rough))
    return Prediction(
        scene=image.scene,
        side=image.side,
        on=image.on,
        level_dn=image.level,
        signal_dn=column.model * factor,
        sharp_laser_dn=column.sharp_laser * factor,
        residual_dn=np.asarray(signal - column.model * factor, np.float32),
        used=image.used,
        dots=dots,
    )
