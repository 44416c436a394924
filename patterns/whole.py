"""Whole-number parameters and the seed."""

from __future__ import annotations

import numpy as np

from starling.patterns.errors import refuse


def whole(name: str, value: int, low: int, high: int, remedy: str = "Give a whole number.") -> int:
    """Refuse anything but an integer in [low, high], booleans included; return a plain int.

    Raises:
        InputError: if `value` is no integer or outside.
    """
    integer = isinstance(value, int | np.integer) and not isinstance(value, bool)
    if not integer or not low <= value <= high:
        raise refuse(name, f"must be an integer in [{low}, {high}]", repr(value), remedy)
    return int(value)


def generator(seed: int) -> np.random.Generator:
    """Numpy's PCG64 generator of a seed: same seed, same bits.

    Raises:
        InputError: if the seed is no integer in [0, 2^63 - 1].
    """
    return np.random.Generator(np.random.PCG64(whole("seed", seed, 0, 2**63 - 1)))
