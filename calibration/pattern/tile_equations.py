"""Normal equations of an image's tiles: what remains for common parameters to answer for.

Levels, slopes and lights' strengths are each tile's own and are eliminated (see
`starling.calibration.least_squares.variable_projection`). Pixels that fit badly, and tiles that do as a whole (texture, a
wrong reference), count less.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from starling.calibration.least_squares import variable_projection
from starling.calibration.least_squares.variable_projection import Array

_ROBUST = 3.0  # Residuals above this many deviations count less (Cauchy).
_OF_NOISE = 0.8741  # Mean of c^2 log(1 + x^2 / c^2), c = 3, of noise x of unit deviation.
_ROUNDS = 2  # Of weights and strengths.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Normal:
    """Normal equations of n common parameters, by tiles."""

    matrix: NDArray[np.float64]  # (n, n)
    right_side: NDArray[np.float64]  # (n,)
    scores: NDArray[np.float64]  # (tiles, n) each tile's share of `right_side`.
    misfit: float  # Robust sum of squared residuals; of noise alone it is `freedom`.
    freedom: int  # Pixels that count, less what was fitted to them.
    strengths: NDArray[np.float64]  # (tiles, k) of the templates; NaN where a tile does not count.


def of(image: Array, weight: Array, templates: Array, columns: Array, *, tile_px: int) -> Normal:
    """Reduce an image to normal equations.

    Args:
        image: (h, w) reading.
        weight: (h, w) over the variance of the reading's noise; 0 where it does not count.
        templates: (k, h, w) lights of strength 1, k >= 1.
        columns: (k, n, h, w) derivatives of the templates by n parameters.
        tile_px: side of a tile.
    """
    layers = list(templates)
    fitted = variable_projection.eliminate(image, layers, weight, size_px=tile_px)
    for _ in range(_ROUNDS):
        # Residuals are weighed already: what was taken off them is put back.
        down = variable_projection.joined(_robust(fitted.unweighed(weight)), image.shape, tile_px)
        fitted = variable_projection.eliminate(image, layers, weight * down, size_px=tile_px)
    slope = fitted.projected([list(column) for column in columns.swapaxes(0, 1)])
    scores = -np.einsum("nmp,nm->np", slope, fitted.residual, optimize=True).astype(np.float64)
    flat = slope.reshape(-1, slope.shape[2])
    return Normal(
        matrix=(flat.T @ flat).astype(np.float64),
        right_side=scores.sum(axis=0),
        scores=scores,
        misfit=misfit(fitted.unweighed(weight)),
        freedom=fitted.freedom,
        strengths=np.where(fitted.used[:, None], fitted.amplitude, np.nan).astype(np.float64),
    )


def total(parts: Sequence[Normal]) -> Normal:
    """Sum the equations of several images."""
    return Normal(
        matrix=np.sum([part.matrix for part in parts], axis=0),
        right_side=np.sum([part.right_side for part in parts], axis=0),
        scores=np.concatenate([part.scores for part in parts]),
        misfit=sum(part.misfit for part in parts),
        freedom=sum(part.freedom for part in parts),
        strengths=np.concatenate([part.strengths for part in parts]),
    )


def misfit(residual: NDArray) -> float:
    """Robust sum of squares (Cauchy's cost) of residuals over their deviations.

    Of normal noise alone it is the number of residuals; one far off adds by its logarithm.
    """
    squares = np.log1p((residual.astype(np.float64) / _ROBUST) ** 2)
    return float(_ROBUST**2 / _OF_NOISE * squares.sum())


def widened(normal: Normal, places: Sequence[int], count: int) -> Normal:
    """Give a part's parameters their places among `count`, of which it tells nothing else."""
    at = np.asarray(places, np.intp)
    matrix, scores = np.zeros((count, count)), np.zeros((len(normal.scores), count))
    matrix[np.ix_(at, at)] = normal.matrix
    scores[:, at] = normal.scores
    return replace(normal, matrix=matrix, right_side=scores.sum(axis=0), scores=scores)


def _robust(residual: Array) -> Array:
    """Weights (n, m) of pixels: their own misfit and the tile's."""
    square = residual**2 / np.float32(_ROBUST**2)
    counted = np.maximum((residual != 0).sum(axis=1, keepdims=True), 1)
    return 1 / (1 + square) / (1 + square.sum(axis=1, keepdims=True) / counted)
