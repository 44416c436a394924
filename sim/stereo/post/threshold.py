"""Threshold filter: removes depth outside a range."""

from __future__ import annotations

import numba as nb
import numpy as np
from numpy.typing import NDArray

from starling.patterns import errors
from starling.sim.stereo.depth import LARGEST_CODE


def limit(
    disparity_px: NDArray[np.float32],
    *,
    focal_px: float,
    baseline_m: float,
    near_m: float,
    far_m: float,
) -> NDArray[np.float32]:
    """Remove depth nearer than `near_m` or farther than `far_m`.

    Args:
        disparity_px: (h, w) [px], NaN = none; values <= 0 are beyond any range.
        focal_px: focal length of the rectified pair [px], > 0.
        baseline_m: baseline of the rectified pair [m], > 0.
        near_m: least accepted depth [m].
        far_m: greatest accepted depth [m].

    Returns:
        (h, w) [px] with NaN for removed depth; the input array if nothing is removed.

    Raises:
        InputError: if focal_px or baseline_m is not finite and positive.

    Source: librealsense, threshold filter (both ends included; its defaults are 0.1 and 4 m).
    """
    errors.positive("focal_px", focal_px)
    errors.positive("baseline_m", baseline_m)
    known = np.ascontiguousarray(disparity_px, np.float32)
    out = np.empty_like(known)
    ends = np.float32(near_m), np.float32(far_m)
    removed = _limit(known.ravel(), np.float32(focal_px * baseline_m), *ends, out.ravel())
    return out if removed else disparity_px


def limit_codes(
    code: NDArray[np.uint16], *, unit_m: float, near_m: float, far_m: float
) -> NDArray[np.uint16]:
    """Remove depth codes nearer than `near_m` or farther than `far_m`, both ends included.

    Args:
        code: (h, w), 0 = none.
        unit_m: depth of code 1 [m].
        near_m: least accepted depth [m].
        far_m: greatest accepted depth [m].

    Returns:
        (h, w) with 0 for removed depth.

    Source: librealsense, threshold filter, with its rounding to float32.
    """
    every_m = np.float32(unit_m) * np.arange(LARGEST_CODE + 1, dtype=np.float32)
    stays = (every_m >= np.float32(near_m)) & (every_m <= np.float32(far_m))
    admitted = np.arange(LARGEST_CODE + 1, dtype=np.uint16) * stays
    return np.take(admitted, code)


@nb.njit(nogil=True, cache=True)
def _limit(disparity, focal_baseline, near, far, out):  # pragma: no cover - compiled
    """Copy accepted values; return the number of removed ones."""
    removed = 0
    for i in range(disparity.size):
        value = disparity[i]
        depth = focal_baseline / max(value, np.float32(1e-30))
        stays = near <= depth <= far
        out[i] = value if stays else np.float32(np.nan)
        removed += value == value and not stays
    return removed
