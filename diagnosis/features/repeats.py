"""Features in time: changes between repeats of a static scene."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from starling.diagnosis.features import bins
from starling.diagnosis.scenes.strata import Strata


def infrared_repeat_features(frames: NDArray, strata: Strata) -> dict[str, float]:
    """Compute temporal noise by level, of whole images (flicker), of rows and of columns.

    Args:
        frames: (n, h, w) images [DN], n >= 2.
        strata: bins of the scene.
    """
    stack = frames.astype(np.float32)
    deviation = stack.std(axis=0, ddof=1)
    features = {
        f"time.noise.{name}": bins.log(bins.mean(deviation, where))
        for name, where in strata.bins("expected")
    }
    means = stack.reshape(len(stack), -1).mean(axis=1)
    features["time.flicker"] = bins.log(float(means.std(ddof=1) / max(means.mean(), 1e-3)))
    change = stack - stack.mean(axis=0)
    features["time.rows"] = bins.log(float(change.mean(axis=2).std()))
    features["time.columns"] = bins.log(float(change.mean(axis=1).std()))
    return features


def depth_repeat_features(frames_px: NDArray, strata: Strata) -> dict[str, float]:
    """Compute temporal noise of disparity, and the rate of holes that appear or vanish.

    Args:
        frames_px: (n, h, w) disparity, NaN where invalid, n >= 2.
        strata: bins of the scene.
    """
    valid = np.isfinite(frames_px)
    steady = valid.all(axis=0)
    step = np.diff(frames_px, axis=0)
    change = np.where(steady, np.abs(step).mean(axis=0), np.nan)
    [(_, everywhere)] = strata.all_pixels()
    features = {
        "time.disparity": bins.log(bins.mean(change, everywhere)),
        "time.holes": bins.rate((valid[1:] != valid[:-1]).any(axis=0), everywhere),
    }
    if len(frames_px) >= 3:
        product = np.where(steady, (step[1:] * step[:-1]).mean(axis=0), np.nan)
        power = np.where(steady, (step**2).mean(axis=0), np.nan)
        # -1/2 for independent frames; closer to 0 with a temporal filter.
        ratio = bins.mean(product, everywhere) / max(bins.mean(power, everywhere), 1e-9)
        features["time.carried on"] = float(ratio)
    return features
