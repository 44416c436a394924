"""Least squares with what differs from tile to tile eliminated: variable projection.

In every tile of an image the reading is a sum of an even level, its slopes, and given templates,
each with a strength of the tile's own. Reflectance, ambient light and the strength of each light
are in those, whatever they are. What remains of residual and derivatives, after the part that they
explain is projected out, is what the common parameters must answer for.

Source: Golub and Pereyra, SIAM J. Numer. Anal. 10(2), 1973; the derivative of the projector itself
is left out as in Kaufman, BIT 15, 1975.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numba as nb
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float32]

_LEAST_PIXELS = 4  # A tile needs this many times the pixels that it has unknowns.
_RIDGE = 1e-9  # Of a basis row's own weight: enough for a template that is nowhere in a tile.
_ROBUST = 3.0  # Residuals above this many deviations count less (Cauchy).
_ROUNDS = 2  # Of weights and strengths.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Normal:
    """Normal equations of the common parameters, by tiles."""

    matrix: NDArray[np.float64]  # (n, n)
    right_side: NDArray[np.float64]  # (n,)
    scores: NDArray[np.float64]  # (tiles, n) each tile's share of `right_side`.
    squares: float  # Weighted sum of squared residuals.
    count: int  # Pixels that count.
    strengths: NDArray[np.float64]  # (tiles, k) of the templates; NaN where a tile does not count.


def eliminate(
    image: Array, weight: Array, templates: Array, columns: Array, *, tile_px: int
) -> Normal:
    """Eliminate level, slopes and templates' strengths in each tile.

    Args:
        image: (h, w) reading.
        weight: (h, w) over the variance of the reading's noise; 0 where it does not count.
        templates: (k, h, w) lights of strength 1, k >= 1.
        columns: (k, n, h, w) derivatives of the templates by n parameters.
        tile_px: side of a tile.

    Returns:
        The sums over all tiles. Pixels that fit badly, and tiles that do as a whole (texture, a
        wrong reference), count less.
    """
    count, height, width = templates.shape
    rows, across = height // tile_px, width // tile_px
    parameters = columns.shape[1]
    scores = np.zeros((rows * across, parameters))
    strengths = np.full((rows * across, count), np.nan)
    matrix = np.zeros((parameters, parameters))
    squares, pixels = _tiles(
        image, weight, templates, columns, tile_px, across, matrix, scores, strengths
    )
    return Normal(
        matrix=matrix,
        right_side=scores.sum(axis=0),
        scores=scores,
        squares=squares,
        count=pixels,
        strengths=strengths,
    )


def total(parts: Sequence[Normal]) -> Normal:
    """Sum the equations of several images."""
    return Normal(
        matrix=np.sum([part.matrix for part in parts], axis=0),
        right_side=np.sum([part.right_side for part in parts], axis=0),
        scores=np.concatenate([part.scores for part in parts]),
        squares=sum(part.squares for part in parts),
        count=sum(part.count for part in parts),
        strengths=np.concatenate([part.strengths for part in parts]),
    )


def widened(normal: Normal, places: Sequence[int], count: int) -> Normal:
    """Give a part's parameters their places among `count`, of which it tells nothing else."""
    at = np.asarray(places, np.intp)
    matrix, scores = np.zeros((count, count)), np.zeros((len(normal.scores), count))
    matrix[np.ix_(at, at)] = normal.matrix
    scores[:, at] = normal.scores
    return replace(normal, matrix=matrix, right_side=scores.sum(axis=0), scores=scores)


@nb.njit(nogil=True, cache=True)
def _tiles(
    image, weight, templates, columns, side, across, matrix, scores, strengths
):  # pragma: no cover - compiled
    k, n = columns.shape[0], columns.shape[1]
    squares, pixels = 0.0, 0
    for tile in range(scores.shape[0]):
        top, left = tile // across * side, tile % across * side
        rows, columns_of = np.nonzero(weight[top : top + side, left : left + side] > 0)
        m = rows.size
        if m < _LEAST_PIXELS * (3 + k):
            continue
        rows += top
        columns_of += left
        basis, reading, root = _basis(image, weight, templates, rows, columns_of, top, left, side)
        scale = np.ones(m)
        for _ in range(_ROUNDS):
            part, coefficients, inverse = _fitted(basis * scale, reading * scale)
            residual = reading - coefficients @ basis
            scale = np.sqrt(_robust(residual))
        part, coefficients, inverse = _fitted(basis * scale, reading * scale)
        residual = (reading - coefficients @ basis) * scale
        derivative = np.zeros((n, m))
        for t in range(k):
            strength = max(coefficients[3 + t], 0.0)
            strengths[tile, t] = strength
            for i in range(n):
                for p in range(m):
                    derivative[i, p] += strength * columns[t, i, rows[p], columns_of[p]]
        derivative *= root * scale
        derivative -= (derivative @ part.T) @ inverse @ part
        score = derivative @ residual
        scores[tile] = score
        matrix += derivative @ derivative.T
        squares += (residual * residual).sum()
        pixels += m
    return squares, pixels


@nb.njit(nogil=True, cache=True)
def _basis(image, weight, templates, rows, columns, top, left, side):  # pragma: no cover - compiled
    """Level, slopes and templates (3 + k, m), and the reading (m,), over the noise's deviation."""
    k, m = templates.shape[0], rows.size
    basis, reading, root = np.empty((3 + k, m)), np.empty(m), np.empty(m)
    for p in range(m):
        y, x = rows[p], columns[p]
        root[p] = np.sqrt(weight[y, x])
        basis[0, p] = root[p]
        basis[1, p] = root[p] * (2 * (x - left) / side - 1)
        basis[2, p] = root[p] * (2 * (y - top) / side - 1)
        for t in range(k):
            basis[3 + t, p] = root[p] * templates[t, y, x]
        reading[p] = root[p] * image[y, x]
    return basis, reading, root


@nb.njit(nogil=True, cache=True)
def _fitted(basis, reading):  # pragma: no cover - compiled
    """The basis, its coefficients and the inverse of its Gram matrix."""
    gram = basis @ basis.T
    for i in range(gram.shape[0]):
        gram[i, i] += _RIDGE * gram[0, 0] + 1e-30
    inverse = np.linalg.inv(gram)
    return basis, inverse @ (basis @ reading), inverse


@nb.njit(nogil=True, cache=True)
def _robust(residual):  # pragma: no cover - compiled
    """Weights of pixels: their own misfit and the tile's."""
    mean = (residual * residual).mean() / _ROBUST**2
    return 1 / (1 + residual * residual / _ROBUST**2) / (1 + mean)
