"""16-bit depth codes before and after the filters, in one pass over the image."""

from __future__ import annotations

import numba as nb
import numpy as np
from numpy.typing import NDArray

from starling.sim.sensor.sensor import Sensor
from starling.sim.stereo.depth import (
    LARGEST_CODE,
    depth_from_disparity,
    disparity_from_depth,
    from_code,
)


def encode(depth_m: NDArray[np.float32], unit_m: float) -> NDArray[np.uint16]:
    """Return the codes of `starling.sim.stereo.depth.to_code`, several times as fast."""
    code = np.empty(depth_m.shape, np.uint16)
    _encode(np.ascontiguousarray(depth_m, np.float32).ravel(), float(unit_m), code.ravel())
    return code


def decode(
    code: NDArray[np.uint16], sensor: Sensor
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return disparity [px] and depth [m] of codes, NaN for code 0; z = f b / d holds."""
    geometry = {"focal_px": sensor.fx_px, "baseline_m": sensor.baseline_m}
    every_m = from_code(np.arange(LARGEST_CODE + 1, dtype=np.uint16), sensor.post.depth_unit_m)
    disparity_px = disparity_from_depth(every_m, **geometry)
    depth_m = depth_from_disparity(disparity_px, **geometry)
    return np.take(disparity_px, code), np.take(depth_m, code)


@nb.njit(nogil=True, cache=True)
def _encode(depth_m, unit_m, code):  # pragma: no cover - compiled
    for i in range(depth_m.size):
        value = np.rint(np.float64(depth_m[i]) / unit_m)
        code[i] = np.uint16(value) if 0 <= value <= LARGEST_CODE else np.uint16(0)
