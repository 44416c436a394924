"""How much each pixel of a captured image counts in a fit of levels."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.calibration.least_squares import tiles
from starling.calibration.photometry.light_model import Columns, Image

Array = NDArray[np.float32]

_MODEL_ERROR = 0.01  # Relative error of the model that no noise accounts for.


def tile_factor(image: Image, signal: Array, model: Array, *, around: int = 0) -> Array:
    """Ratio of captured to predicted signal, tile by tile (h, w); 1 where nothing counts.

    Args:
        image: whose pixels count or not.
        signal: captured, less the black level [DN] (h, w).
        model: predicted [DN] (h, w).
        around: tiles on each side that are averaged over too.
    """
    shape = (model.shape[0], model.shape[1])
    grid = (shape[0] // tiles.TILE_PX, shape[1] // tiles.TILE_PX)
    used = tiles.tiled(image.used)
    window = (2 * around + 1, 2 * around + 1)
    seen, expected = (
        np.asarray(cv2.blur((tiles.tiled(p) * used).sum(axis=1).reshape(grid), window)).ravel()
        for p in (signal, model)
    )
    ratio = np.where(expected > 0, seen / np.maximum(expected, 1e-30), 1.0)
    return np.nan_to_num(tiles.spread(np.maximum(ratio, 1e-3), shape), nan=1.0)


def weight(image: Image, column: Columns, factor: Array | None, *, misfit: float = 0.0) -> Array:
    """One over the variance that noise, speckle and the model's own error have (h, w).

    Args:
        image: whose pixels count or not.
        column: its prediction.
        factor: by which reflectance differs from the given; None is 1.
        misfit: of its dots, as `dots_misfit` has it.
    """
    least, per_signal, per_laser = column.variance
    signal = column.model if factor is None else column.model * factor
    laser = column.laser if factor is None else column.laser * factor
    variance = least + per_signal * np.maximum(signal, 0) + per_laser * laser**2
    variance += (_MODEL_ERROR * signal) ** 2
    if misfit:
        shape = (laser.shape[0], laser.shape[1])
        square = tiles.spread(tiles.tiled(laser**2).mean(axis=1), shape)
        variance += misfit**2 * np.nan_to_num(square)
    return np.where(image.used, 1 / variance, 0).astype(np.float32)


def dots_misfit(image: Image, signal: Array, column: Columns, weight: Array) -> float:
    """Error of the laser's light in a pixel beyond noise, over its root mean square in a tile.

    Dots a little off their places, or stronger or weaker than the pattern's: pixels that are to be
    dark then have light of a dot beside them. Weighed by their own noise alone they would count
    most, and all dots be taken for weaker than they are.

    Args:
        image: whose pixels count or not.
        signal: captured, less the black level [DN] (h, w).
        column: its prediction.
        weight: one over the variance without this error (h, w).

    Returns:
        The median over tiles; 0 where there is no laser light.
    """
    factor = tiles.fitted_factor(signal, column.model, weight)
    counts = weight > 0
    noise = np.where(counts, 1 / np.where(counts, weight, 1), 0)
    beyond = np.where(counts, (signal - column.model * factor) ** 2 - noise, 0)
    light = np.where(counts, (column.laser * factor) ** 2, 0)
    beyond, light = (tiles.tiled(part).sum(axis=1) for part in (beyond, light))
    lit = light > 0
    return float(np.sqrt(max(np.median(beyond[lit] / light[lit]), 0))) if lit.any() else 0.0
