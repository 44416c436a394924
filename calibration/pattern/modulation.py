"""Local modulation of an image, independent of reflectance and level.

The dots on a surface scale with its reflectance. Subtracting the local mean and dividing by the
local deviation leaves the pattern, if the surface has no texture of the size of dots.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from starling.calibration import detail
from starling.calibration.detail import high_passed
from starling.calibration.pattern.views import Array, PatternView

_LEAST_DEVIATION_DN = 0.5  # Minimum deviation; a smaller one is quantisation.
_STEP_DN2 = 1 / 12  # Quantisation variance.
_MOST_WEIGHT = 50.0  # Maximum weight: texture and model errors limit a strong pattern.


class Modulation(NamedTuple):
    """A view's image, normalised by local mean and deviation."""

    value: Array  # (h, w), with unit local deviation.
    weight: Array  # (h, w), inverse noise variance; 0 for unusable pixels.


def from_view(view: PatternView, *, dn_per_electron: float, black_level_dn: float) -> Modulation:
    """Normalise a view by local mean and deviation.

    Args:
        view: view with dots.
        dn_per_electron: conversion gain, for the shot noise [DN / electron].
        black_level_dn: black level of the image.
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
