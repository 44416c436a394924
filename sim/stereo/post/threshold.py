"""Threshold: depth outside a range is no depth."""

from __future__ import annotations

import numba as nb
import numpy as np
from numpy.typing import NDArray

from starling.patterns import errors


def limit(
    disparity_px: NDArray[np.float32],
    *,
    focal_px: float,
    baseline_m: float,
    near_m: float,
    far_m: float,
) -> NDArray[np.float32]:
    """Take away what is nearer than `near_m` or farther than `far_m`.

    Args:
        disparity_px: (h, w) [px], NaN = none; <= 0 is beyond any range.
        focal_px: of the rectified pair [px], > 0.
        baseline_m: of the rectified pair [m], > 0.
        near_m: least depth that stays [m].
        far_m: greatest depth that stays [m].

    Returns:
        (h, w) [px] with NaN where depth was outside; the input itself where nothing was.

    Raises:
        InputError: if focal_px or baseline_m is not finite and positive.

    Source: librealsense, threshold filter (both ends stay; its own defaults are 0.1 and 4 m).
    """
    errors.positive("focal_px", focal_px)
    errors.positive("baseline_m", baseline_m)
    known = np.ascontiguousarray(disparity_px, np.float32)
    out = np.empty_like(known)
    ends = np.float32(near_m), np.float32(far_m)
    taken = _limit(known.ravel(), np.float32(focal_px * baseline_m), *ends, out.ravel())
    return out if taken else disparity_px


@nb.njit(nogil=True, cache=True)
def _limit(disparity, focal_baseline, near, far, out):  # pragma: no cover - compiled
    """Copy what stays; return how many were taken away."""
    taken = 0
    for i in range(disparity.size):
        value = disparity[i]
        depth = focal_baseline / max(value, np.float32(1e-30))
        stays = near <= depth <= far
        out[i] = value if stays else np.float32(np.nan)
        taken += value == value and not stays
    return taken
