"""Least squares tile by tile: what each tile scales as it likes is eliminated in it.

Where the reflectance of a surface is unknown it is a free factor a tile with a gradient, c: the
level is b + c m with m the light model. Eliminating c (variable projection) leaves what no smooth
reflectance can imitate: the dots' contrast within a tile, and how the tiles' offsets and slopes
go together.

What differs from `starling.calibration.least_squares.variable_projection`: a tile has one factor in all images of an
imager, lit and unlit, and the black level is no tile's own but common. So images' products are
added before the factor is eliminated, and products of columns are all that is kept; there, where
every image has strengths of its own, residuals stay pixel by pixel, to be weighed one by one.

Source: Golub and Pereyra, SIAM J. Numer. Anal. 10 (1973) 413; Kaufman, BIT 15 (1975) 49.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from starling.calibration.least_squares.variable_projection import cut

TILE_PX = 16
FEWEST = 0.5  # Share of a tile's pixels that must count.
CLUSTERS_ACROSS = 10  # Of the image: squares in which errors may go together.

_UNDETERMINED = 1e-9  # Share of the largest eigenvalue that counts as none.
_PART = 1e-3  # Of a parameter in undetermined directions that makes it open.
_LEAST_REST = 0.01  # Of a direction's weight that other clusters hold, at least.

Array = NDArray[np.float64]

_OUTLYING = 3.0  # Median costs above which a tile is weighed down.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Normal:
    """Normal equations of each cluster; they add."""

    matrices: Array  # (n, p, p) J^T W J
    scores: Array  # (n, p) J^T W r
    cost: float  # Weighted mean squared residual.

    def step(self) -> Array:
        """Gauss-Newton step (p,); along directions that nothing determines it is 0."""
        root, _ = _inverse_root(self.matrices.sum(axis=0))
        return root.T @ (root @ self.scores.sum(axis=0))

    def covariance(self) -> Array:
        """Covariance (p, p) that holds when residuals of one cluster go together; inf where open.

        The sandwich of clusters' scores, each enlarged by (1 - leverage)^(-1/2): the plain one
        takes what rests on few clusters for surer than it is.

        Source: Bell and McCaffrey, Survey Methodology 28 (2002) 169 ("bias reduced", CR2).
        """
        root, open_ = _inverse_root(self.matrices.sum(axis=0))
        leverage, axes = np.linalg.eigh(root @ self.matrices @ root.T)
        grown = 1 / np.sqrt(np.maximum(1 - leverage, _LEAST_REST))
        along = np.einsum("nij,ni->nj", axes, self.scores @ root.T)
        scores = np.einsum("nij,nj->ni", axes, grown * along)
        covariance = root.T @ (scores.T @ scores) @ root
        covariance[open_, :] = covariance[:, open_] = 0.0
        covariance[open_, open_] = np.inf
        return covariance


def _inverse_root(matrix: Array) -> tuple[Array, NDArray[np.bool_]]:
    """R with R^T R the inverse, whatever the units, and which parameters are open.

    Directions that nothing determines are left out of R.
    """
    scale = np.sqrt(np.maximum(np.diagonal(matrix), 1e-300))
    values, vectors = np.linalg.eigh(matrix / np.outer(scale, scale))
    none = values <= _UNDETERMINED * max(float(values.max()), 1e-300)
    inverse = np.where(none, 0, 1 / np.sqrt(np.where(none, 1, values)))
    open_ = (vectors[:, none] ** 2).sum(axis=1) > _PART
    return (inverse * vectors).T / scale, open_


def tiled(image: NDArray) -> NDArray:
    """Cut (h, w) into tiles (n, 256); what does not fill a tile is left out."""
    return cut(image, TILE_PX)


def spread(values: NDArray, shape: tuple[int, int]) -> NDArray[np.float32]:
    """Give each pixel of an image (h, w) its tile's value (n,); what is left over, NaN."""
    rows, columns = shape[0] // TILE_PX, shape[1] // TILE_PX
    grid = values.reshape(rows, columns)
    out = np.full(shape, np.nan, np.float32)
    out[: rows * TILE_PX, : columns * TILE_PX] = grid.repeat(TILE_PX, 0).repeat(TILE_PX, 1)
    return out


def clusters(shape: tuple[int, int]) -> NDArray[np.int64]:
    """Number of the cluster that each tile (n,) of an image (h, w) belongs to."""
    rows, columns = shape[0] // TILE_PX, shape[1] // TILE_PX
    side = max(columns // CLUSTERS_ACROSS, 1)
    row, column = np.mgrid[:rows, :columns] // side
    return (row * (-(-columns // side)) + column).ravel()


def grams(columns: list[NDArray], weight: NDArray, *, means: bool) -> Array:
    """Weighted products of columns within each tile, (n, k, k).

    Args:
        columns: k images (h, w).
        weight: (h, w), 0 where a pixel does not count; a tile with under half its pixels is left
            out whole.
        means: compare tiles' means only, as where the dots' places are not known.
    """
    weights = tiled(weight).astype(np.float64)
    weights[(weights > 0).mean(axis=1) < FEWEST] = 0
    stack = np.stack([tiled(column) for column in columns], axis=1).astype(np.float64)
    if means:
        total = weights.sum(axis=1)
        mean = np.einsum("nkp,np->nk", stack, weights) / np.maximum(total, 1e-300)[:, None]
        return np.einsum("nk,nl,n->nkl", mean, mean, total)
    return (stack * weights[:, None]) @ stack.transpose(0, 2, 1)


def eliminated(gram: Array, count: int) -> tuple[Array, Array]:
    """Project columns out of products; also the first one's coefficient in each tile (n,).

    Args:
        gram: (n, k, k) of [residual r, `count` columns to eliminate, Jacobian columns...]; where
            those have no length, the tile counts for nothing.
        count: of the columns to eliminate.

    Returns:
        (n, k - count, k - count) of [r, Jacobian columns...] less what the eliminated columns
        explain, and the first one's least-squares coefficient.
    """
    rest = np.delete(np.arange(gram.shape[1]), np.arange(1, 1 + count))
    along, within, scale = _solved(gram, count)
    inner = gram[:, rest][:, :, rest] - along.transpose(0, 2, 1) @ within
    counts = gram[:, 1, 1] > 0
    return np.where(counts[:, None, None], inner, 0.0), np.where(
        counts, within[:, 0, 0] / scale[:, 0], 0.0
    )


def _solved(gram: Array, count: int) -> tuple[Array, Array, Array]:
    """Least squares of all columns by some: their products and coefficients, and the norms.

    The columns eliminated, as in `eliminated`, are taken of unit norm.
    """
    gone = np.arange(1, 1 + count)
    rest = np.delete(np.arange(gram.shape[1]), gone)
    own = gram[:, gone][:, :, gone]
    scale = np.sqrt(np.maximum(np.diagonal(own, axis1=1, axis2=2), 1e-300))
    along = gram[:, gone][:, :, rest] / scale[:, :, None]
    scaled = own / (scale[:, :, None] * scale[:, None, :])
    return along, np.linalg.pinv(scaled, rcond=1e-6, hermitian=True) @ along, scale


def ramps(shape: tuple[int, int]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Place within the tile, across and down, from -1 to 1 (h, w)."""
    row, column = np.mgrid[: shape[0], : shape[1]] % TILE_PX
    across, down = ((2 * (axis + 0.5) / TILE_PX - 1).astype(np.float32) for axis in (column, row))
    return across, down


def fitted_factor(signal: NDArray, model: NDArray, weight: NDArray) -> NDArray[np.float32]:
    """Factor c (h, w), linear within each tile, by which the model comes nearest to the signal.

    Args:
        signal: (h, w).
        model: (h, w).
        weight: (h, w), 0 where a pixel does not count; where no tile counts, c is 1.
    """
    shape = (model.shape[0], model.shape[1])
    bases = (np.ones(shape, np.float32), *ramps(shape))
    gram = grams([signal, *(model * base for base in bases)], weight, means=False)
    _, within, scale = _solved(gram, len(bases))
    found = within[:, :, 0] / scale
    found[gram[:, 1, 1] <= 0] = (1.0, 0.0, 0.0)
    parts = (spread(found[:, k], shape) * base for k, base in enumerate(bases))
    return np.nan_to_num(np.sum(list(parts), axis=0), nan=1.0).astype(np.float32)


def normal(gram: Array, counts: Array, cluster: NDArray[np.int64]) -> Normal:
    """Sum tiles' products to normal equations; tiles that fit far worse than most count less.

    Args:
        gram: (n, 1 + p, 1 + p) of [r, Jacobian columns...].
        counts: (n,) pixels (or means) that each tile's cost sums over.
        cluster: (n,) number of each tile's cluster.
    """
    used = counts > 0
    gram, counts, cluster = gram[used], counts[used], cluster[used]
    each = np.maximum(gram[:, 0, 0], 0) / counts
    usual = max(float(np.median(each)), 1e-300)
    weight = np.minimum(1.0, _OUTLYING * usual / np.maximum(each, 1e-300))
    number, place = np.unique(cluster, return_inverse=True)
    size = gram.shape[1] - 1
    matrices, scores = np.zeros((len(number), size, size)), np.zeros((len(number), size))
    np.add.at(matrices, place, gram[:, 1:, 1:] * weight[:, None, None])
    np.add.at(scores, place, gram[:, 1:, 0] * weight[:, None])
    return Normal(
        matrices=matrices,
        scores=scores,
        cost=float((weight * gram[:, 0, 0]).sum() / max(float((weight * counts).sum()), 1e-300)),
    )
