"""Types of the arrays that images are made of, and arrays with unknown values."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from starling.patterns.errors import instance, refuse
from starling.patterns.errors import numbers as numbers

Image = NDArray[np.float32]  # (h, w) or (h, w, n).
Mask = NDArray[np.bool_]  # (h, w), True where a statement holds.
Labels = NDArray[np.uint32]  # (h, w) codes or object numbers.


def check_form(
    name: str, array: object, shape: tuple[int | str, ...], *, kinds: str = "fiu"
) -> None:
    """Refuse a value that is no array of real numbers with the given shape.

    Masked arrays and matrices are refused: their arithmetic differs.

    Args:
        name: name of the array in the user's words.
        array: value to check.
        shape: number of entries on each axis; a letter stands for any number above 0.
        kinds: accepted kinds of numpy's data types.

    Raises:
        InputError: if the value has another type, data type or shape.
    """
    array = instance(name, array, np.ndarray, "Give a numpy array.")
    if isinstance(array, (np.ma.MaskedArray, np.matrix)):
        raise refuse(name, "must be a plain array", type(array).__name__, "Convert it.")
    if array.dtype.kind not in kinds:
        sort = {"f": "floating-point", "iu": "whole"}.get(kinds, "real")
        raise refuse(name, f"must hold {sort} numbers", array.dtype, "Convert it.")
    sizes = zip(array.shape, shape, strict=False)
    same = all(size == count or (isinstance(count, str) and size) for size, count in sizes)
    if array.ndim != len(shape) or not same:
        listed = ", ".join(map(str, shape))
        raise refuse(name, f"must be ({listed}), not empty", array.shape, "Reshape it.")


def filled(values: Image, known: Mask) -> Image:
    """Return the map with each unknown pixel set to the value of the nearest known pixel.

    Args:
        values: (h, w).
        known: (h, w) mask.

    Raises:
        InputError: if no pixel is known.
    """
    from scipy import ndimage  # Heavy, and needed here only.

    if not known.any():
        raise refuse("reference depth", "must be known somewhere", "no pixel", "Check truth.png.")
    if known.all():
        return values
    nearest = ndimage.distance_transform_edt(~known, return_distances=False, return_indices=True)
    return values[tuple(np.asarray(nearest))]


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
