"""Least squares by tiles with a free reflectance factor in each tile.

An unknown reflectance is a free linear factor c in each tile: the level is b + c m, where m is the
light model. Variable projection eliminates c. A smooth reflectance cannot
explain the contrast of the dots within a tile, nor the relation between the tiles' offsets and
slopes. This information remains.

This differs from `starling.calibration.least_squares.variable_projection` in two ways. A tile has
one factor for all images of an imager, lit and unlit, and the black level is common to all tiles.
So products of columns are summed over images before the factor is eliminated. The other module has
separate strengths in each image and keeps the residuals of single pixels for robust weights.

Source: Golub and Pereyra, SIAM J. Numer. Anal. 10 (1973) 413; Kaufman, BIT 15 (1975) 49.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from starling.calibration.least_squares.variable_projection import cut

TILE_PX = 16
FEWEST = 0.5  # Minimum share of used pixels in a tile.
CLUSTERS_ACROSS = 10  # Columns of clusters (squares of correlated errors) in the image.

_UNDETERMINED = 1e-9  # Relative eigenvalue up to which a direction is undetermined.
_PART = 1e-3  # Squared component in undetermined directions that makes a parameter open.
_LEAST_REST = 0.01  # Minimum of 1 - leverage.

Array = NDArray[np.float64]

_OUTLYING = 3.0  # Cost over the median cost above which a tile is downweighted.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class ClusterEquations:
    """Normal equations of each cluster."""

    matrices: Array  # (n, p, p) J^T W J
    scores: Array  # (n, p) J^T W r
    cost: float  # Weighted mean squared residual.

    def step(self) -> Array:
        """Return the Gauss-Newton step (p,); it is 0 along undetermined directions."""
        root, _ = _inverse_root(self.matrices.sum(axis=0))
        return root.T @ (root @ self.scores.sum(axis=0))

    def covariance(self) -> Array:
        """Return the covariance (p, p), robust to correlation within clusters; inf where open.

        It is the sandwich of the clusters' scores, each scaled by (1 - leverage)^(-1/2). The plain
        sandwich underestimates the variance of parameters that depend on few clusters.

        Source: Bell and McCaffrey, Survey Methodology 28 (2002) 169 ("bias reduced", CR2).
        """
        root, is_open = _inverse_root(self.matrices.sum(axis=0))
        leverage, axes = np.linalg.eigh(root @ self.matrices @ root.T)
        inflation = 1 / np.sqrt(np.maximum(1 - leverage, _LEAST_REST))
        projected = np.einsum("nij,ni->nj", axes, self.scores @ root.T)
        scores = np.einsum("nij,nj->ni", axes, inflation * projected)
        covariance = root.T @ (scores.T @ scores) @ root
        covariance[is_open, :] = covariance[:, is_open] = 0.0
        covariance[is_open, is_open] = np.inf
        return covariance


def _inverse_root(matrix: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Return R with R^T R the inverse, and a mask of the open parameters.

    The result does not depend on units. R excludes undetermined directions.
    """
    scale = np.sqrt(np.maximum(np.diagonal(matrix), 1e-300))
    values, vectors = np.linalg.eigh(matrix / np.outer(scale, scale))
    undetermined = values <= _UNDETERMINED * values.max(initial=1e-300)
    inverse = np.where(undetermined, 0, 1 / np.sqrt(np.where(undetermined, 1, values)))
    is_open = (vectors[:, undetermined] ** 2).sum(axis=1) > _PART
    return (inverse * vectors).T / scale, is_open


def cut_tiles(image: NDArray) -> NDArray:
    """Cut (h, w) into tiles (n, 256); incomplete tiles are dropped."""
    return cut(image, TILE_PX)


def to_pixels(values: NDArray, shape: tuple[int, ...]) -> NDArray[np.float32]:
    """Expand tile values (n,) to an image (h, w); pixels outside complete tiles are NaN."""
    rows, columns = shape[0] // TILE_PX, shape[1] // TILE_PX
    grid = values.reshape(rows, columns)
    image = np.full(shape, np.nan, np.float32)
    image[: rows * TILE_PX, : columns * TILE_PX] = grid.repeat(TILE_PX, 0).repeat(TILE_PX, 1)
    return image


def clusters(shape: tuple[int, ...]) -> NDArray[np.int64]:
    """Return the cluster number of each tile (n,) of an image (h, w)."""
    rows, columns = shape[0] // TILE_PX, shape[1] // TILE_PX
    side = max(columns // CLUSTERS_ACROSS, 1)
    row, column = np.mgrid[:rows, :columns] // side
    return (row * (-(-columns // side)) + column).ravel()


def grams(columns: list[NDArray], weight: NDArray, *, means: bool) -> Array:
    """Return weighted products of columns within each tile, (n, k, k).

    Args:
        columns: k images (h, w).
        weight: (h, w), 0 for unused pixels. A tile with less than half of its pixels is unused.
        means: use only the means of tiles, for dots at unknown positions.
    """
    weights = cut_tiles(weight).astype(np.float64)
    weights[(weights > 0).mean(axis=1) < FEWEST] = 0
    stack = np.stack([cut_tiles(column) for column in columns], axis=1).astype(np.float64)
    if means:
        total = weights.sum(axis=1)
        mean = np.einsum("nkp,np->nk", stack, weights) / np.maximum(total, 1e-300)[:, None]
        return np.einsum("nk,nl,n->nkl", mean, mean, total)
    return (stack * weights[:, None]) @ stack.transpose(0, 2, 1)


def eliminate(gram: Array, count: int) -> tuple[Array, Array]:
    """Project columns out of products.

    Args:
        gram: (n, k, k) of [residual r, `count` columns to eliminate, Jacobian columns...]. A tile
            is unused if its first eliminated column is zero.
        count: number of columns to eliminate.

    Returns:
        (n, k - count, k - count) of [r, Jacobian columns...] after projection, and the
        least-squares coefficient (n,) of the first eliminated column.
    """
    rest = np.delete(np.arange(gram.shape[1]), np.arange(1, 1 + count))
    products, coefficients, scale = _solved(gram, count)
    inner = gram[:, rest][:, :, rest] - products.transpose(0, 2, 1) @ coefficients
    counts = gram[:, 1, 1] > 0
    return np.where(counts[:, None, None], inner, 0.0), np.where(
        counts, coefficients[:, 0, 0] / scale[:, 0], 0.0
    )


def _solved(gram: Array, count: int) -> tuple[Array, Array, Array]:
    """Regress the remaining columns on the eliminated ones, as in `eliminate`.

    Returns products and coefficients for eliminated columns of unit norm, and their norms.
    """
    eliminated = np.arange(1, 1 + count)
    rest = np.delete(np.arange(gram.shape[1]), eliminated)
    normal_matrix = gram[:, eliminated][:, :, eliminated]
    scale = np.sqrt(np.maximum(np.diagonal(normal_matrix, axis1=1, axis2=2), 1e-300))
    products = gram[:, eliminated][:, :, rest] / scale[:, :, None]
    scaled = normal_matrix / (scale[:, :, None] * scale[:, None, :])
    return products, np.linalg.pinv(scaled, rcond=1e-6, hermitian=True) @ products, scale


def ramps(shape: tuple[int, ...]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return the position within the tile, horizontal and vertical, from -1 to 1 (h, w)."""
    row, column = np.mgrid[: shape[0], : shape[1]] % TILE_PX
    across, down = ((2 * (axis + 0.5) / TILE_PX - 1).astype(np.float32) for axis in (column, row))
    return across, down


def fit_factor(signal: NDArray, model: NDArray, weight: NDArray) -> NDArray[np.float32]:
    """Fit the factor c (h, w), linear within each tile, of a model to a signal.

    Args:
        signal: (h, w).
        model: (h, w).
        weight: (h, w), 0 for unused pixels; c is 1 in unused tiles.
    """
    bases = (np.ones_like(model, np.float32), *ramps(model.shape))
    gram = grams([signal, *(model * base for base in bases)], weight, means=False)
    _, tile_coefficients, scale = _solved(gram, len(bases))
    coefficients = tile_coefficients[:, :, 0] / scale
    coefficients[gram[:, 1, 1] <= 0] = (1.0, 0.0, 0.0)
    planes = (to_pixels(coefficients[:, k], model.shape) * base for k, base in enumerate(bases))
    return np.nan_to_num(np.sum(list(planes), axis=0), nan=1.0).astype(np.float32)


def sum_clusters(gram: Array, counts: Array, cluster: NDArray[np.int64]) -> ClusterEquations:
    """Sum tiles' products to normal equations by cluster; outlying tiles are downweighted.

    Args:
        gram: (n, 1 + p, 1 + p) of [r, Jacobian columns...].
        counts: (n,) number of pixels (or means) in each tile's cost.
        cluster: (n,) cluster number of each tile.
    """
    used = counts > 0
    gram, counts, cluster = gram[used], counts[used], cluster[used]
    tile_costs = np.maximum(gram[:, 0, 0], 0) / counts
    median_cost = max(float(np.median(tile_costs)), 1e-300)
    weight = np.minimum(1.0, _OUTLYING * median_cost / np.maximum(tile_costs, 1e-300))
    number, index = np.unique(cluster, return_inverse=True)
    size = gram.shape[1] - 1
    matrices, scores = np.zeros((len(number), size, size)), np.zeros((len(number), size))
    np.add.at(matrices, index, gram[:, 1:, 1:] * weight[:, None, None])
    np.add.at(scores, index, gram[:, 1:, 0] * weight[:, None])
    return ClusterEquations(
        matrices=matrices,
        scores=scores,
        cost=float((weight * gram[:, 0, 0]).sum() / max(float((weight * counts).sum()), 1e-300)),
    )
