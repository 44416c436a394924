"""Position of imaged points in the projector's field of view."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from starling.sim.geometry import frames
from starling.sim.sensor.sensor import Sensor


def tangents(depth_m: NDArray, sensor: Sensor, *, right: bool = False) -> NDArray[np.float32]:
    """Compute x / z and y / z of each pixel's point in the projector's frame.

    Args:
        depth_m: (h, w) depth along the imager's optical axis.
        sensor: intrinsics of the imagers and pose of the projector.
        right: True if `depth_m` belongs to the right imager.

    Returns:
        (h, w, 2); NaN where depth is unknown.
    """
    y, x = np.indices(depth_m.shape, np.float64)
    ray = np.stack(
        [(x - sensor.cx_px) / sensor.fx_px, (y - sensor.cy_px) / sensor.fy_px, np.ones_like(x)],
        axis=-1,
    )
    point = ray * depth_m[..., None]
    if right:
        point = point + np.array([sensor.baseline_m * (1 + sensor.baseline_error), 0.0, 0.0])
    part = sensor.projector
    local = (point - np.array(part.position_m)) @ frames.rotation(part.rotation_deg)
    with np.errstate(invalid="ignore", divide="ignore"):
        return (local[..., :2] / local[..., 2:]).astype(np.float32)
