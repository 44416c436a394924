"""How a disparity map errs and where it has none: by depth, place, level, edges, fraction."""

from __future__ import annotations

import numpy as np

from starling.diagnosis.features import bins
from starling.diagnosis.scenes.strata import FAR_OFF_PX, Ground, Image

_PLACES = ("depth", "x", "y", "radius", "level", "incidence")


def disparity(found_px: Image, ground: Ground) -> dict[str, float]:
    """Errors against the reference, and shares without depth.

    Args:
        found_px: (h, w) measured disparity; NaN where there is none.
        ground: of the scene.
    """
    error = found_px - ground.disparity_px
    near = np.where(np.abs(error) <= FAR_OFF_PX, error, np.nan)
    [(_, everywhere)], [(_, far)] = ground.whole(), ground.whole(far=True)
    found_there = np.isfinite(found_px)
    missing = ~found_there
    off = np.nan_to_num(np.abs(error), nan=0.0) > FAR_OFF_PX
    middle, spread = bins.median_and_spread(near, far)
    found = {
        "error.bias.all": middle,
        "error.spread.all": spread,
        "error.far off.all": bins.rate(off, bins.among(everywhere, found_there)),
        "holes.all": bins.rate(missing, everywhere),
    }
    for name, where in ground.each(*_PLACES, far=True):
        bias, spread = bins.median_and_spread(near, where)
        found |= {f"error.bias.{name}": bias, f"error.spread.{name}": spread}
    for name, where in ground.each(*_PLACES):
        found[f"holes.{name}"] = bins.rate(missing, where)
    for name, where in ground.each("edge"):
        bias, spread = bins.median_and_spread(near, where)
        found |= {f"error.bias.{name}": bias, f"error.spread.{name}": spread}
        found[f"error.far off.{name}"] = bins.rate(off, bins.among(where, found_there))
        found[f"holes.{name}"] = bins.rate(missing, where)
    for name, where in ground.each("fraction", far=True):
        found[f"error.fraction.{name}"] = bins.median(near, where) - middle
    return found
