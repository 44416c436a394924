"""Ray-traced depth of a table before a wall with a box, a ball and a sheet."""

from __future__ import annotations

import numpy as np

from starling.sim.captures.info import CaptureInfo
from starling.sim.geometry.frames import rotation

INFO = CaptureInfo(
    sensor="d415", width=480, height=360, fx_px=450, fy_px=450, cx_px=240, cy_px=180,
    baseline_m=0.055, depth_unit_m=0.001, source="drawn", licence="none", notes="",
)  # fmt: skip
BOX_CENTRE_M = np.array([0.02, 0.02, 0.9])
BOX_SIDES_M = np.array([0.24, 0.2, 0.16])
BOX_TURN = rotation((35.0, 30.0, 10.0))  # left_from_box
BALL_CENTRE_M, BALL_RADIUS_M = np.array([0.27, -0.06, 0.8]), 0.09
WALL_M = 1.6


def rays() -> np.ndarray:
    """Directions (h, w, 3) with z = 1."""
    y, x = np.indices(INFO.shape, float)
    return np.stack(
        [(x - INFO.cx_px) / INFO.fx_px, (y - INFO.cy_px) / INFO.fy_px, np.ones_like(x)], axis=-1
    )


def box_depth() -> np.ndarray:
    """Depth of the box alone; infinite elsewhere."""
    start, way = -BOX_CENTRE_M @ BOX_TURN, rays() @ BOX_TURN
    item, second = ((side * BOX_SIDES_M / 2 - start) / way for side in (-1, 1))
    near, far = np.minimum(item, second).max(axis=-1), np.maximum(item, second).min(axis=-1)
    return np.where(near < far, near, np.inf)


def ball_depth() -> np.ndarray:
    """Depth of the ball alone; infinite elsewhere."""
    way = rays()
    a, b = (way**2).sum(axis=-1), way @ BALL_CENTRE_M
    root = b**2 - a * (BALL_CENTRE_M @ BALL_CENTRE_M - BALL_RADIUS_M**2)
    return np.where(root > 0, (b - np.sqrt(np.maximum(root, 0))) / a, np.inf)


def depth() -> np.ndarray:
    """The whole scene (h, w) [m]."""
    wall = np.full(INFO.shape, WALL_M)
    return np.minimum(np.minimum(wall, box_depth()), ball_depth()).astype(np.float32)
