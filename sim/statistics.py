"""Statistics of arrays in which NaN marks unknown values."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def mean_known(values: NDArray[np.float64], axis: int | tuple[int, ...]) -> NDArray[np.float64]:
    """Mean of the known values; NaN, without a warning, where there are none.

    Args:
        values: Values, NaN where unknown.
        axis: As in numpy.
    """
    known = np.isfinite(values)
    count = known.sum(axis=axis)
    total = np.where(known, values, 0.0).sum(axis=axis)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)
