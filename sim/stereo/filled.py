"""Filling of unknown pixels in a map."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from starling.patterns.errors import refuse

Image = NDArray[np.float32]


def filled(values: Image, known: NDArray[np.bool_]) -> Image:
    """Return the map with each unknown pixel set to the value of the nearest known pixel.

    Args:
        values: (h, w).
        known: (h, w) mask.

    Raises:
        InputError: if no pixel is known.
    """
    if not known.any():
        raise refuse("reference depth", "must be known somewhere", "no pixel", "Check truth.png.")
    if known.all():
        return values
    nearest = ndimage.distance_transform_edt(~known, return_distances=False, return_indices=True)
    return values[tuple(np.asarray(nearest))]
