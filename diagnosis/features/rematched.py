"""Depth beside what our matcher makes of the same infrared pair, and beside the device's own."""

from __future__ import annotations

import numpy as np

from starling.diagnosis.features import bins
from starling.diagnosis.scenes.strata import FAR_OFF_PX, Ground, Image

_PLACES = ("edge", "level", "depth")
_MOST_PX = 1.0  # Apart: beyond, one of them is a wrong match, and how wrong tells nothing.


def against(found_px: Image, ours_px: Image, ground: Ground) -> dict[str, float]:
    """Which way depth is off our matcher's.

    How far is not asked: that is nothing where our matcher is simulated, so that whatever makes
    its depth another would come nearer to a device's.

    Args:
        found_px: (h, w) disparity; NaN where there is none.
        ours_px: (h, w) that of our matcher, no effect set.
        ground: of the scene.
    """
    difference = found_px - ours_px
    near = np.where(np.abs(difference) < FAR_OFF_PX, difference, np.nan)
    return {
        f"against.bias.{name}": bins.median(near, where)
        for name, where in (*ground.whole(), *ground.each(*_PLACES))
    }


def unlike(found_px: Image, captured_px: Image, ground: Ground) -> dict[str, float]:
    """How far depth is from the device's own, pixel by pixel: nothing if it is that.

    Args:
        found_px: (h, w) disparity; NaN where there is none.
        captured_px: (h, w) what the device gave of the same pair.
        ground: of the scene.
    """
    measured, captured = np.isfinite(found_px), np.isfinite(captured_px)
    both = measured & captured
    apart = np.minimum(np.abs(found_px - captured_px), _MOST_PX)
    found = {}
    for name, where in (*ground.whole(), *ground.each(*_PLACES)):
        found[f"unlike.holes.{name}"] = bins.rate(measured != captured, where)
        found[f"unlike.disparity.{name}"] = bins.mean(apart, bins.among(where, both))
    return found
