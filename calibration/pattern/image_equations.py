"""Normal equations of a view for the parameters that move the emitter of a pattern image.

The residual model equals that of the image (`starling.calibration.pattern.unprojected`): the same
blur, local gain and window. With another model, the residual would contain model errors many times
the noise, and steps and deviations would be too small.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from starling.calibration.least_squares import variable_projection
from starling.calibration.pattern import tile_equations, unprojected
from starling.calibration.pattern.tile_equations import NormalEquations
from starling.calibration.pattern.unprojected import PlacedView
from starling.calibration.pattern.views import Array
from starling.sim import metrics

_ROBUST = 3.0  # Scale of the Cauchy weights [robust standard deviations].
_LEAST_STIFF = 0.1  # Minimum curvature over the mean weight.


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
        misfit=tile_equations.misfit(residual),
        freedom=int(counted.sum()),
        strengths=np.ones((len(scores), 1)),
    )


def _robust_deviation(residual: Array) -> float:
    """Return the robust standard deviation of residuals (n,)."""
    if residual.size == 0:
        return 1.0
    return max(metrics.MAD_TO_SIGMA * float(np.median(np.abs(residual))), 1e-6)
