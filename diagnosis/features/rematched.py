"""Features of depth relative to our matcher's depth and to the captured device depth."""

from __future__ import annotations

import numpy as np

from starling.diagnosis.features import bins
from starling.diagnosis.scenes.strata import FAR_OFF_PX, Image, Strata

_PLACES = ("edge", "level", "depth")
_MOST_PX = 1.0  # Upper limit of a difference: beyond it is a wrong match of unknown size.


def bias_features(measured_px: Image, ours_px: Image, strata: Strata) -> dict[str, float]:
    """Compute the median difference from our matcher's disparity, by bin.

    The spread is not a feature. It is zero where our matcher is simulated, so that any effect on
    depth would increase it towards the device's.

    Args:
        measured_px: (h, w) disparity; NaN where invalid.
        ours_px: (h, w) disparity by our matcher without effects.
        strata: bins of the scene.
    """
    difference = measured_px - ours_px
    near = np.where(np.abs(difference) < FAR_OFF_PX, difference, np.nan)
    return {
        f"against.bias.{name}": bins.median(near, where)
        for name, where in (*strata.all_pixels(), *strata.bins(*_PLACES))
    }


def difference_features(measured_px: Image, captured_px: Image, strata: Strata) -> dict[str, float]:
    """Compute pixelwise differences from the captured device disparity, by bin.

    Args:
        measured_px: (h, w) disparity; NaN where invalid.
        captured_px: (h, w) captured device disparity of the same pair.
        strata: bins of the scene.
    """
    measured, captured = np.isfinite(measured_px), np.isfinite(captured_px)
    both = measured & captured
    difference = np.minimum(np.abs(measured_px - captured_px), _MOST_PX)
    features = {}
    for name, where in (*strata.all_pixels(), *strata.bins(*_PLACES)):
        features[f"unlike.holes.{name}"] = bins.rate(measured != captured, where)
        features[f"unlike.disparity.{name}"] = bins.mean(difference, bins.among(where, both))
    return features
