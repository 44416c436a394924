"""A disparity map without unknown pixels, so that what is measured on it has none either."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from starling.patterns.errors import refuse

Image = NDArray[np.float32]


def filled(values: Image, known: NDArray[np.bool_]) -> Image:
    """Give each unknown pixel the value of the nearest known one.

    Args:
        values: (h, w).
        known: (h, w).

    Raises:
        InputError: if nothing is known.
    """
    if not known.any():
        raise refuse("reference depth", "must be known somewhere", "no pixel", "Check truth.png.")
    if known.all():
        return values
    nearest = ndimage.distance_transform_edt(~known, return_distances=False, return_indices=True)
    return values[tuple(np.asarray(nearest))]
