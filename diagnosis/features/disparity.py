"""Features of a disparity map's errors and holes."""

from __future__ import annotations

import numpy as np

from starling.diagnosis.features import bins
from starling.diagnosis.scenes.strata import FAR_OFF_PX, Image, Strata

_PLACES = ("depth", "x", "y", "radius", "level", "incidence")


def disparity_features(measured_px: Image, strata: Strata) -> dict[str, float]:
    """Compute bias, spread and rates of wrong matches and holes, by bin.

    Args:
        measured_px: (h, w) measured disparity; NaN where invalid.
        strata: reference and bins of the scene.
    """
    error = measured_px - strata.disparity_px
    near = np.where(np.abs(error) <= FAR_OFF_PX, error, np.nan)
    [(_, everywhere)], [(_, interior)] = strata.all_pixels(), strata.all_pixels(interior=True)
    valid = np.isfinite(measured_px)
    missing = ~valid
    wrong = np.nan_to_num(np.abs(error), nan=0.0) > FAR_OFF_PX
    middle, spread = bins.median_and_spread(near, interior)
    features = {
        "error.bias.all": middle,
        "error.spread.all": spread,
        "error.far off.all": bins.rate(wrong, bins.among(everywhere, valid)),
        "holes.all": bins.rate(missing, everywhere),
    }
    for name, where in strata.bins(*_PLACES, interior=True):
        bias, spread = bins.median_and_spread(near, where)
        features |= {f"error.bias.{name}": bias, f"error.spread.{name}": spread}
    for name, where in strata.bins(*_PLACES):
        features[f"holes.{name}"] = bins.rate(missing, where)
    for name, where in strata.bins("edge"):
        bias, spread = bins.median_and_spread(near, where)
        features |= {f"error.bias.{name}": bias, f"error.spread.{name}": spread}
        features[f"error.far off.{name}"] = bins.rate(wrong, bins.among(where, valid))
        features[f"holes.{name}"] = bins.rate(missing, where)
    for name, where in strata.bins("fraction", interior=True):
        features[f"error.fraction.{name}"] = bins.median(near, where) - middle
    return features
