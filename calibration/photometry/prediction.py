"""Prediction of each captured image by a fit of levels."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from starling.calibration.least_squares import tiles
from starling.calibration.photometry import light_model, weights
from starling.calibration.photometry.levels import Side
from starling.calibration.photometry.light_model import CapturedImage, LevelsCache
from starling.sim.arrays import Mask
from starling.sim.sensor.sensor import Sensor

Array = NDArray[np.float32]


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Prediction:
    """Prediction of one image; arrays are (h, w)."""

    scene: str
    side: Side
    on: bool
    level_dn: Array  # Captured level, including the black level.
    signal_dn: Array  # Predicted light above black.
    sharp_laser_dn: Array  # Laser light in it, before crosstalk and averaging.
    residual_dn: Array
    used: Mask
    dots: bool  # Whether observed and predicted dots match, so that residuals are meaningful.


def predict(
    image: CapturedImage,
    values: Mapping[str, float],
    sensor: Sensor,
    formed: LevelsCache,
    *,
    reflectance_free: bool,
    dots: bool,
) -> Prediction:
    """Predict an image; with `reflectance_free`, fit a factor and a gradient in each tile."""
    column = light_model.columns(image, values, sensor, (), formed)
    signal = light_model.above_black(image, values, sensor)
    factor: Array | np.float32 = np.float32(1)
    if reflectance_free:
        mean_factor = weights.tile_factor(image, signal, column.model)
        factor = tiles.fit_factor(signal, column.model, weights.weight(image, column, mean_factor))
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
