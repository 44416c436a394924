"""Synthetic examples: a small camera before surfaces with known disparities."""

from __future__ import annotations

import numpy as np

from starling.learning.data.example import Example
from starling.sim.captures.info import CaptureInfo

WIDTH, HEIGHT = 120, 60
FOCAL_PX, BASELINE_M = 100.0, 0.05


def info(sensor: str = "a test's own") -> CaptureInfo:
    """Return a camera of 120 x 60 pixels whose disparity at 1 m is 5 px."""
    return CaptureInfo(
        sensor=sensor,
        width=WIDTH,
        height=HEIGHT,
        fx_px=FOCAL_PX,
        fy_px=FOCAL_PX,
        cx_px=(WIDTH - 1) / 2,
        cy_px=(HEIGHT - 1) / 2,
        baseline_m=BASELINE_M,
        depth_unit_m=0.001,
        source="made by a test",
        licence="Apache-2.0",
        notes="",
    )


def example(disparity_px: np.ndarray, **known: object) -> Example:
    """Return a scene with given reference disparities (h, w), NaN where unknown."""
    depth_m = (FOCAL_PX * BASELINE_M / disparity_px).astype(np.float32)
    chosen = {"scene": "a", "room": "a", "info": info(), "depth_m": depth_m, **known}
    return Example(**chosen)  # type: ignore[arg-type]


def flat(disparity_px: float = 5.0) -> np.ndarray:
    """Return the disparities (h, w) of a wall that faces the camera."""
    return np.full((HEIGHT, WIDTH), disparity_px)


def box(first: int, last: int, *, back_px: float = 5.0, front_px: float = 15.0) -> np.ndarray:
    """Return the disparities (h, w) of a wall behind a box in columns `first` to `last`."""
    disparity = flat(back_px)
    disparity[:, first : last + 1] = front_px
    return disparity
