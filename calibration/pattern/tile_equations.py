"""Normal equations of an image's tiles for common parameters.

For lattices (`reduce_image`), levels, slopes and strengths of each tile are eliminated
(`starling.calibration.least_squares.variable_projection`). Pixels and whole tiles with a large
residual, from texture or a wrong reference, are downweighted.

For the emitter of a pattern image (`reduce_view`), the residual model equals that of the image
(`starling.calibration.pattern.unprojected`): the same blur, local gain and window. With another
model, the residual would contain model errors many times the noise, and steps and deviations would
be too small.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from starling.calibration.least_squares import variable_projection
from starling.calibration.pattern import unprojected
from starling.calibration.pattern.unprojected import PlacedView
from starling.calibration.pattern.views import Array
from starling.sim import metrics

_ROBUST = 3.0  # Scale of the Cauchy weights [standard deviations].
_OF_NOISE = 0.8741  # Mean of c^2 log(1 + x^2 / c^2) for c = 3 and standard normal x.
_ROUNDS = 2  # Rounds of weights and strengths.
_LEAST_STIFF = 0.1  # Minimum curvature over the mean weight.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class NormalEquations:
    """Normal equations of n common parameters, with the contribution of each tile."""

    matrix: NDArray[np.float64]  # (n, n)
    right_side: NDArray[np.float64]  # (n,)
    scores: NDArray[np.float64]  # (tiles, n) contribution of each tile to `right_side`.
    misfit: float  # Robust sum of squared residuals; noise alone gives `freedom`.
    freedom: int  # Degrees of freedom: used pixels minus eliminated coefficients.
    strengths: NDArray[np.float64]  # (tiles, k) of the templates; NaN for unused tiles.


def reduce_image(
    image: Array, weight: Array, templates: Array, columns: Array, *, tile_px: int
) -> NormalEquations:
    """Reduce an image to normal equations.

    Args:
        image: (h, w) observed levels.
        weight: (h, w) inverse noise variance; 0 for unused pixels.
        templates: (k, h, w) light layers of strength 1, k >= 1.
        columns: (k, n, h, w) derivatives of the templates by n parameters.
        tile_px: side of a tile.
    """
    layers = list(templates)
    fitted = variable_projection.eliminate(image, layers, weight, size_px=tile_px)
    for _ in range(_ROUNDS):
        # Remove the robust weights from the residuals before new weights are computed.
        robust_weight = variable_projection.join(
            _robust(fitted.reweighted(weight)), image.shape, tile_px
        )
        fitted = variable_projection.eliminate(
            image, layers, weight * robust_weight, size_px=tile_px
        )
    slope = fitted.project([list(column) for column in columns.swapaxes(0, 1)])
    scores = -np.einsum("nmp,nm->np", slope, fitted.residual, optimize=True).astype(np.float64)
    flat = slope.reshape(-1, slope.shape[2])
    return NormalEquations(
        matrix=(flat.T @ flat).astype(np.float64),
        right_side=scores.sum(axis=0),
        scores=scores,
        misfit=misfit(fitted.reweighted(weight)),
        freedom=fitted.freedom,
        strengths=np.where(fitted.used[:, None], fitted.amplitude, np.nan).astype(np.float64),
    )


def reduce_view(
    view: PlacedView, light: Array, columns: Mapping[str, Array], *, tile_px: int
) -> NormalEquations:
    """Reduce a view to normal equations of its columns, in their order.

    Texture and the image's grid leave residuals above the noise, so a robust deviation sets the
    scale of the weights. The matrix is the mean curvature of the robust cost. With the weights
    instead, steps and deviations would be too small.

    Args:
        view: view with its local gain.
        light: (h, w) light of the pattern from `emitter_model.illuminate`.
        columns: (h, w) derivatives of the light by parameter.
        tile_px: side of the tiles over which scores are summed.

    Source: Huber and Ronchetti, Robust Statistics (2009), sec. 7.6 (curvature).
    """
    assert view.gain is not None
    gain, root = view.gain, np.sqrt(view.modulation.weight)

    def weighted(image: Array) -> Array:
        tiles = variable_projection.cut(
            root * gain * unprojected.imaged(image, view.blur_px), tile_px
        )
        return tiles.astype(np.float64)

    observed = variable_projection.cut(root * view.modulation.value, tile_px)
    residual = observed - weighted(light)
    counted = variable_projection.cut(root, tile_px) > 0
    square = (residual / (_ROBUST * _robust_deviation(residual[counted]))) ** 2
    weight = counted / (1 + square)
    curvature = counted * (1 - square) / (1 + square) ** 2
    stiffness = max(float(curvature.sum()) / max(float(weight.sum()), 1e-6), _LEAST_STIFF)
    slope = np.stack([weighted(column) for column in columns.values()], axis=-1)
    weighed = slope * weight[..., None]
    scores = (residual[:, None, :] @ weighed)[:, 0]
    return NormalEquations(
        matrix=stiffness * np.tensordot(weighed, slope, axes=((0, 1), (0, 1))),
        right_side=scores.sum(axis=0),
        scores=scores,
        misfit=misfit(residual),
        freedom=int(counted.sum()),
        strengths=np.ones((len(scores), 1)),
    )


def total(parts: Sequence[NormalEquations]) -> NormalEquations:
    """Sum the equations of several images."""
    return NormalEquations(
        matrix=np.sum([part.matrix for part in parts], axis=0),
        right_side=np.sum([part.right_side for part in parts], axis=0),
        scores=np.concatenate([part.scores for part in parts]),
        misfit=sum(part.misfit for part in parts),
        freedom=sum(part.freedom for part in parts),
        strengths=np.concatenate([part.strengths for part in parts]),
    )


def misfit(residual: NDArray) -> float:
    """Return the robust sum of squares (Cauchy's cost) of normalised residuals.

    Normal noise gives the number of residuals. An outlier contributes by its logarithm.
    """
    squares = np.log1p((residual.astype(np.float64) / _ROBUST) ** 2)
    return float(_ROBUST**2 / _OF_NOISE * squares.sum())


def embed(normal: NormalEquations, places: Sequence[int], count: int) -> NormalEquations:
    """Embed normal equations in the full system of `count` parameters (zeros elsewhere)."""
    indices = np.asarray(places, np.intp)
    matrix, scores = np.zeros((count, count)), np.zeros((len(normal.scores), count))
    matrix[np.ix_(indices, indices)] = normal.matrix
    scores[:, indices] = normal.scores
    return replace(normal, matrix=matrix, right_side=scores.sum(axis=0), scores=scores)


def _robust(residual: Array) -> Array:
    """Return the weights (n, m) of pixels, from the residual of the pixel and of its tile."""
    square = residual**2 / np.float32(_ROBUST**2)
    counted = np.maximum((residual != 0).sum(axis=1, keepdims=True), 1)
    return 1 / (1 + square) / (1 + square.sum(axis=1, keepdims=True) / counted)


def _robust_deviation(residual: Array) -> float:
    """Return the robust standard deviation of residuals (n,)."""
    if residual.size == 0:
        return 1.0
    return max(metrics.MAD_TO_SIGMA * float(np.median(np.abs(residual))), 1e-6)
