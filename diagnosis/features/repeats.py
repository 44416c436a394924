"""What changes from frame to frame of a scene that keeps still."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from starling.diagnosis.features import bins
from starling.diagnosis.scenes.strata import Ground


def infrared(frames: NDArray, ground: Ground) -> dict[str, float]:
    """Noise in time by level, its share of what all frames have in common, flicker.

    Args:
        frames: (n, h, w) codes, n >= 2.
        ground: of the scene.
    """
    stack = frames.astype(np.float32)
    deviation = stack.std(axis=0, ddof=1)
    found = {
        f"time.noise.{name}": bins.log(bins.mean(deviation, where))
        for name, where in ground.each("expected")
    }
    means = stack.reshape(len(stack), -1).mean(axis=1)
    found["time.flicker"] = bins.log(float(means.std(ddof=1) / max(means.mean(), 1e-3)))
    rows = stack - stack.mean(axis=0)
    found["time.rows"] = bins.log(float(rows.mean(axis=2).std()))
    found["time.columns"] = bins.log(float(rows.mean(axis=1).std()))
    return found


def depth(frames_px: NDArray, ground: Ground) -> dict[str, float]:
    """Noise of the disparity in time, holes that come and go.

    Args:
        frames_px: (n, h, w) disparity, NaN where there is none, n >= 2.
        ground: of the scene.
    """
    valid = np.isfinite(frames_px)
    steady = valid.all(axis=0)
    step = np.diff(frames_px, axis=0)
    change = np.where(steady, np.abs(step).mean(axis=0), np.nan)
    [(_, everywhere)] = ground.whole()
    found = {
        "time.disparity": bins.log(bins.mean(change, everywhere)),
        "time.holes": bins.rate((valid[1:] != valid[:-1]).any(axis=0), everywhere),
    }
    if len(frames_px) >= 3:
        product = np.where(steady, (step[1:] * step[:-1]).mean(axis=0), np.nan)
        power = np.where(steady, (step**2).mean(axis=0), np.nan)
        # -1/2 for independent frames; nearer 0 where a filter carries them on.
        ratio = bins.mean(product, everywhere) / max(bins.mean(power, everywhere), 1e-9)
        found["time.carried on"] = float(ratio)
    return found
