"""Input and target of a prediction method: one scene."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from starling.sim.captures.info import CaptureInfo

Image = NDArray[np.float32]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Physics:
    """Results of repeated simulations of a scene, all (h, w) in the left view."""

    ndp: Image  # Share of the draws without depth, 0 to 1.
    draws: int  # Number of draws; the resolution of `ndp` is 1 / draws.
    infrared: Image  # Simulated left image without noise, relative to full scale, 0 to 1.
    contrast: Image  # Local standard deviation of that image over its local mean.
    disparity_px: Image  # Mean over the draws with depth; NaN where none has depth.
    one_draw_px: Image  # Noisy disparity of the first draw with depth; NaN where none has depth.
    one_draw_ndp: Mask  # Pixels without depth of the first draw.
    reason: NDArray[np.uint32]  # Most frequent `starling.sim.reason` of no depth; 0 for depth.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Example:
    """A scene with its reference depth in the left view."""

    scene: str
    room: str  # Splits are by room.
    info: CaptureInfo  # Image size, intrinsics, baseline.
    depth_m: Image  # (h, w) reference depth; NaN where unknown.
    reflectance: Image | None = None  # (h, w) near-infrared, 0 to 1, smoothed until no dot remains.
    # (h, w) where the device has no depth; None where it is to be predicted.
    ndp: Mask | None = None
    counted: Mask | None = None  # (h, w) where `ndp` counts; None like `ndp`.
    physics: Physics | None = None

    @property
    def simulated_error_px(self) -> Image | None:
        """Simulated disparity of one draw less the reference's (h, w); None without physics."""
        if self.physics is None:
            return None
        return self.physics.one_draw_px - self.info.disparity_px(self.depth_m)
