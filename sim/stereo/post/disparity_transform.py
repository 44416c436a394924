"""Disparity transform: 16-bit depth to disparity and back, as between librealsense's filters."""

from __future__ import annotations

import numba as nb
import numpy as np
from numpy.typing import NDArray

from starling.sim.sensor.sensor import Sensor
from starling.sim.stereo.depth import LARGEST_CODE

_MM = np.float32(1e-3)
_STEPS = np.float32(32)  # librealsense's disparities are in 1/32 px.


def product(sensor: Sensor, side: int) -> np.float32:
    """Return disparity [px of the decimated image] times depth [depth units].

    Rounded to float32 after each operation, in librealsense's order, so that results have its bits.

    Args:
        sensor: its focal length, baseline and depth unit.
        side: side of a block of the decimation filter [px].

    Source: librealsense, disparity transform.
    """
    focal_px = np.float32(sensor.fx_px) / np.float32(side)
    baseline_m = np.float32(sensor.baseline_m * 1e3) * _MM
    steps = baseline_m * focal_px * _STEPS
    return np.float32(steps / np.float32(sensor.post.depth_unit_m) / _STEPS)


def to_disparity(code: NDArray[np.uint16], product: np.float32) -> NDArray[np.float32]:
    """Convert depth codes to disparity [px of the decimated image], NaN for code 0."""
    disparity_px = np.empty(code.shape, np.float32)
    _to_disparity(np.ascontiguousarray(code).ravel(), product, disparity_px.ravel())
    return disparity_px


def to_code(disparity_px: NDArray[np.float32], product: np.float32) -> NDArray[np.uint16]:
    """Convert disparity to depth codes: rounded, halves upwards; 0 for NaN."""
    code = np.empty(disparity_px.shape, np.uint16)
    _to_code(np.ascontiguousarray(disparity_px).ravel(), product, code.ravel())
    return code


@nb.njit(nogil=True, cache=True)
def _to_disparity(code, product, disparity_px):  # pragma: no cover - compiled
    for i in range(code.size):
        value = np.float32(max(code[i], 1))
        disparity_px[i] = product / value if code[i] else np.float32(np.nan)


@nb.njit(nogil=True, cache=True, error_model="numpy")
def _to_code(disparity_px, product, code):  # pragma: no cover - compiled
    largest = np.float32(LARGEST_CODE)
    for i in range(code.size):
        value = product / disparity_px[i] + np.float32(0.5)
        code[i] = np.uint16(min(value, largest)) if value == value else np.uint16(0)
