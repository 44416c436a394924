"""Prediction of captured images by a fit of levels, and weights of their pixels."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.calibration.least_squares import tiles
from starling.calibration.observation import Side
from starling.calibration.photometry import light_model
from starling.calibration.photometry.light_model import CapturedImage, LevelsCache, LightColumns
from starling.sim.arrays import Mask
from starling.sim.sensor.sensor import Sensor

Array = NDArray[np.float32]

_MODEL_ERROR = 0.01  # Relative model error, in addition to noise.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Prediction:
    """Prediction of one image; arrays are (h, w)."""

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
    dots: bool,
) -> Prediction:
    """Predict an image, with a fitted factor and gradient of reflectance in each tile."""
    column = light_model.columns(image, values, sensor, (), formed)
    signal = light_model.above_black(image, values)
    mean_factor = tile_factor(image, signal, column.model)
    factor = tiles.fit_factor(signal, column.model, weight(image, column, mean_factor))
    return Prediction(
        side=image.side,
        on=image.on,
        level_dn=image.level,
        signal_dn=column.model * factor,
        sharp_laser_dn=column.sharp_laser * factor,
        residual_dn=np.asarray(signal - column.model * factor, np.float32),
        used=image.used,
        dots=dots,
    )


def tile_factor(image: CapturedImage, signal: Array, model: Array, *, around: int = 0) -> Array:
    """Return the ratio of captured to predicted signal by tile (h, w); 1 in unused tiles.

    Args:
        image: image with its mask of used pixels.
        signal: captured signal above black [DN] (h, w).
        model: predicted signal [DN] (h, w).
        around: radius of the average in tiles.
    """
    grid = tuple(length // tiles.TILE_PX for length in model.shape)
    used_pixels = tiles.cut_tiles(image.used)
    window = (2 * around + 1, 2 * around + 1)
    observed, expected = (
        np.asarray(
            cv2.blur((tiles.cut_tiles(picture) * used_pixels).sum(axis=1).reshape(grid), window)
        ).ravel()
        for picture in (signal, model)
    )
    ratio = np.where(expected > 0, observed / np.maximum(expected, 1e-30), 1.0)
    return np.nan_to_num(tiles.to_pixels(np.maximum(ratio, 1e-3), model.shape), nan=1.0)


def weight(
    image: CapturedImage, column: LightColumns, factor: Array, *, misfit: float = 0.0
) -> Array:
    """Return the inverse variance of noise, speckle and model error (h, w).

    Args:
        image: image with its mask of used pixels.
        column: its prediction.
        factor: reflectance relative to that of the model.
        misfit: relative error of the dots from `dots_misfit`.
    """
    constant, per_signal, per_laser = column.variance
    signal, laser = column.model * factor, column.laser * factor
    variance = constant + per_signal * np.maximum(signal, 0) + per_laser * laser**2
    variance += (_MODEL_ERROR * signal) ** 2
    if misfit:
        square = tiles.to_pixels(tiles.cut_tiles(laser**2).mean(axis=1), laser.shape)
        variance += misfit**2 * np.nan_to_num(square)
    return np.where(image.used, 1 / variance, 0).astype(np.float32)


def dots_misfit(image: CapturedImage, signal: Array, column: LightColumns, weight: Array) -> float:
    """Return the laser-light error in excess of noise, over the laser's RMS in a tile.

    If dots are slightly displaced, or differ in strength from the pattern, pixels with a dark
    prediction receive light from adjacent dots. Weighted by noise alone, these pixels would
    dominate and bias the strength of all dots downwards.

    Args:
        image: image with its mask of used pixels.
        signal: captured signal above black [DN] (h, w).
        column: its prediction.
        weight: inverse variance without this error (h, w).

    Returns:
        The median over tiles; 0 without laser light.
    """
    factor = tiles.fit_factor(signal, column.model, weight)
    counts = weight > 0
    noise = np.where(counts, 1 / np.where(counts, weight, 1), 0)
    excess = np.where(counts, (signal - column.model * factor) ** 2 - noise, 0)
    light = np.where(counts, (column.laser * factor) ** 2, 0)
    excess, light = (tiles.cut_tiles(sums).sum(axis=1) for sums in (excess, light))
    lit = light > 0
    return float(np.sqrt(max(np.median(excess[lit] / light[lit]), 0))) if lit.any() else 0.0
