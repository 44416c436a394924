"""A near pillar before a wall; half-occluded pixels have no depth."""

from __future__ import annotations

import numpy as np

from starling.learning.data.example import Example, Image, Physics
from starling.sim.captures.info import CaptureInfo
from starling.sim.reason import Reason

SHAPE = (48, 64)
INFO = CaptureInfo(
    sensor="made",
    width=SHAPE[1],
    height=SHAPE[0],
    fx_px=80.0,
    fy_px=80.0,
    cx_px=31.5,
    cy_px=23.5,
    baseline_m=0.05,
    depth_unit_m=0.001,
    source="made by a test",
    licence="Apache-2.0",
    notes="",
)


def step_scene(number: int, *, room: str | None = None) -> Example:
    """A pillar at 0.25 to 0.4 m before a wall at 1 to 2 m.

    Left of the pillar, the right imager does not see a band of the wall . Its width is the
    difference of the disparities, 6 to 14 pixels. Pillars are at random places. Only columns that
    can be half-occluded equally often are counted, so that the column alone is uninformative.
    """
    rng = np.random.default_rng(number)
    wall_px, pillar_px = 4.0 / rng.uniform(1, 2), 4.0 / rng.uniform(0.25, 0.4)
    disparity = np.full(SHAPE, wall_px)
    left = int(rng.integers(16, 62))
    disparity[:, left : left + int(rng.integers(10, 20))] = pillar_px
    ndp = np.zeros(SHAPE, bool)
    ndp[:, left - round(pillar_px - wall_px) : left] = True
    counted = np.zeros(SHAPE, bool)
    counted[:, 16:48] = True
    return Example(
        scene=f"scene{number}",
        room=room or f"room{number}",
        info=INFO,
        depth_m=(4.0 / disparity).astype(np.float32),
        reflectance=np.full(SHAPE, 0.5, np.float32),
        ndp=ndp,
        counted=counted,
        physics=physics(ndp, rng),
    )


def physics(ndp: np.ndarray, rng: np.random.Generator) -> Physics:
    """Eight simulated draws with half of the holes and some false ones."""
    rate = np.where(ndp, 0.5, 0.1)
    share = rng.binomial(8, rate).astype(np.float32) / 8
    reason = np.where(share > 0.5, Reason.OCCLUDED, Reason.VALID).astype(np.uint32)
    return Physics(
        ndp=share,
        draws=8,
        infrared=_image(rng, 0.3),
        contrast=_image(rng, 0.2),
        disparity_px=np.where(share == 1, np.nan, 3.0).astype(np.float32),
        one_draw_px=np.where(share == 1, np.nan, 3.0).astype(np.float32),
        one_draw_ndp=rng.random(share.shape) < share,
        reason=reason,
    )


def _image(rng: np.random.Generator, top: float) -> Image:
    return rng.uniform(0, top, SHAPE).astype(np.float32)
