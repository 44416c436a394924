"""Several depths of one frame brought to one."""

from __future__ import annotations

import numpy as np

from starling.learning.completion.frame import Image


def joined(drawn_m: Image) -> tuple[Image, Image]:
    """Mean and standard deviation of depths.

    Args:
        drawn_m: (n, h, w) [m].

    Returns:
        Mean (h, w) [m], NaN where any is; sample standard deviation (h, w) [m], NaN of one alone.
    """
    mean = drawn_m.mean(axis=0, dtype=np.float64)
    if len(drawn_m) < 2:
        return mean.astype(np.float32), np.full_like(drawn_m[0], np.nan)
    return mean.astype(np.float32), drawn_m.std(axis=0, ddof=1, dtype=np.float64).astype(np.float32)
