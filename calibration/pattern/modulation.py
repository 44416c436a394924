"""How far light varies about its surroundings, apart from reflectance and level.

Dots on a surface scale with its reflectance and with the level of all other light beside them; what
is left after subtracting the neighbourhood's mean and dividing by its deviation is the pattern's
share, as far as the surface has no texture of the dots' own size.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from starling.calibration import detail
from starling.calibration.detail import high_passed
from starling.calibration.pattern.views import Array, View

_LEAST_DEVIATION_DN = 0.5  # Half a code: less is the converter's own steps.
_STEP_DN2 = 1 / 12  # Variance of rounding to whole codes.
_MOST_WEIGHT = 50.0  # A strong pattern is limited by texture and model, not by noise.


class Modulation(NamedTuple):
    """A view's image as what its neighbourhood makes of it."""

    value: Array  # (h, w), of unit deviation.
    weight: Array  # (h, w), over the variance of its noise; 0 where not usable.


def of(view: View, *, dn_per_electron: float, black_level_dn: float) -> Modulation:
    """Take reflectance and level out of a view.

    Args:
        view: an image with dots.
        dn_per_electron: conversion, for the shot noise [DN / electron].
        black_level_dn: of the image.
    """
    varying = high_passed(view.level_dn)
    deviation = np.sqrt(detail.variance(varying))
    above = detail.mean(view.level_dn) - np.float32(black_level_dn)
    noise = _STEP_DN2 + np.float32(dn_per_electron) * np.maximum(above, 0)
    weight = np.minimum(deviation**2 / noise, _MOST_WEIGHT)
    return Modulation(
        value=varying / np.maximum(deviation, _LEAST_DEVIATION_DN),
        weight=np.where(view.usable, weight, 0).astype(np.float32),
    )
