"""Normal equations of a view that shows a pattern as an image: what moves the image's emitter.

The residual is the one that the image itself was solved with (`starling.calibration.pattern.unprojected`):
blur, local gain and neighbourhood alike. Residuals of another model would hold, many times the
noise, what the image cannot follow there, and steps would come out short and sure.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from starling.calibration.least_squares import variable_projection
from starling.calibration.pattern import tile_equations, unprojected
from starling.calibration.pattern.tile_equations import Normal
from starling.calibration.pattern.unprojected import Placed
from starling.calibration.pattern.views import Array
from starling.sim import metrics

_ROBUST = 3.0  # Residuals above this many times the usual one count less (Cauchy).
_LEAST_STIFF = 0.1  # Of the weights' mean: a curvature of less is chance.


def of(one: Placed, light: Array, columns: Mapping[str, Array], *, tile_px: int) -> Normal:
    """Reduce a view to normal equations of its columns, in their order.

    Texture and the image's own grid leave residuals above the noise; the usual one sets the scale
    from which they count less. The matrix is the robust cost's mean curvature: with the weights in
    its place steps are too short, and deviations too small.

    Args:
        one: view with its local gain.
        light: (h, w) of the pattern, as `emitter_model.lay` gives it.
        columns: (h, w) derivatives of the light by parameter.
        tile_px: side of the tiles that the scores are summed over.

    Source: Huber and Ronchetti, Robust Statistics (2009), sec. 7.6 (curvature).
    """
    assert one.gain is not None
    gain, root = one.gain, np.sqrt(one.modulation.weight)

    def shown(image: Array) -> Array:
        cut = variable_projection.cut(root * gain * unprojected.shown(image, one.blur_px), tile_px)
        return cut.astype(np.float64)

    seen = variable_projection.cut(root * one.modulation.value, tile_px)
    residual = seen - shown(light)
    counted = variable_projection.cut(root, tile_px) > 0
    square = (residual / (_ROBUST * _usual(residual[counted]))) ** 2
    weight = counted / (1 + square)
    curvature = counted * (1 - square) / (1 + square) ** 2
    stiffness = max(float(curvature.sum()) / max(float(weight.sum()), 1e-6), _LEAST_STIFF)
    slope = np.stack([shown(column) for column in columns.values()], axis=-1)
    weighed = slope * weight[..., None]
    scores = (residual[:, None, :] @ weighed)[:, 0]
    return Normal(
        matrix=stiffness * np.tensordot(weighed, slope, axes=((0, 1), (0, 1))),
        right_side=scores.sum(axis=0),
        scores=scores,
        misfit=tile_equations.misfit(residual),
        freedom=int(counted.sum()),
        strengths=np.ones((len(scores), 1)),
    )


def _usual(residual: Array) -> float:
    """Deviation of most residuals (n,)."""
    if residual.size == 0:
        return 1.0
    return max(metrics.MAD_TO_SIGMA * float(np.median(np.abs(residual))), 1e-6)
