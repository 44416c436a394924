"""Statistics of what is known, where NaN marks what is not."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def mean_known(values: NDArray[np.float64], axis: int | tuple[int, ...]) -> NDArray[np.float64]:
    """Mean of what is known; NaN, without a warning, where nothing is.

    Args:
        values: NaN where not known.
        axis: as numpy has it.
    """
    known = np.isfinite(values)
    count = known.sum(axis=axis)
    total = np.where(known, values, 0.0).sum(axis=axis)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)
