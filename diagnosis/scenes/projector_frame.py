"""Where in a projector's field the points lie that an imager sees."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from starling.sim.geometry import frames
from starling.sim.sensor.sensor import Sensor


def tangents(depth_m: NDArray, sensor: Sensor, *, right: bool = False) -> NDArray[np.float32]:
    """x / z and y / z in the projector's frame (h, w, 2); NaN where there is no depth.

    Args:
        depth_m: (h, w) z along the imager's axis.
        sensor: both imagers' intrinsics and the projector's pose.
        right: the depth is the right imager's.
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
