"""Depth images of a plane and a ball in closed form."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from starling.sim.geometry import frames
from starling.sim.geometry.frames import Pose
from starling.sim.geometry.pinhole import Pinhole

CAMERA = Pinhole(width=120, height=90, fx_px=110.0, fy_px=118.0, cx_px=57.3, cy_px=46.1)
NORMAL = np.array([0.3, 0.1, 0.95]) / np.linalg.norm([0.3, 0.1, 0.95])
AWAY_M = 1.0  # Of the plane from the origin, along its normal.
MIDDLE_M, RADIUS_M = np.array([0.05, 0.02, 1.0]), 0.25


def poses(count: int, turn_deg: float = 17.0) -> list[Pose]:
    """Return poses around a point 1 m in front of the origin."""
    turns = np.linspace(-turn_deg, turn_deg, count)
    back = frames.pose((0, 0, -1.0))
    return [frames.pose((0, 0, 1.0), (0.3 * turn, turn, 0.1 * turn)) @ back for turn in turns]


def plane(pose: Pose) -> NDArray[np.float32]:
    """Depth (h, w) of the plane."""
    way = _ways() @ pose[:3, :3].T
    return ((AWAY_M - pose[:3, 3] @ NORMAL) / (way @ NORMAL)).astype(np.float32)


def ball(pose: Pose) -> NDArray[np.float32]:
    """Depth (h, w) of the ball, NaN outside it."""
    way, start = _ways() @ pose[:3, :3].T, pose[:3, 3] - MIDDLE_M
    a, b, c = (way**2).sum(-1), way @ start, start @ start - RADIUS_M**2
    inside = b**2 - a * c
    with np.errstate(invalid="ignore"):
        return ((-b - np.sqrt(inside)) / a).astype(np.float32)


def _ways() -> NDArray[np.float64]:
    """Ray of each pixel in the camera's frame, z = 1."""
    u, v = np.meshgrid(np.arange(CAMERA.width), np.arange(CAMERA.height))
    x, y = (u - CAMERA.cx_px) / CAMERA.fx_px, (v - CAMERA.cy_px) / CAMERA.fy_px
    return np.stack([x, y, np.ones_like(x)], axis=-1)
