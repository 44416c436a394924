"""What a method sees of one scene, and what it is asked for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from starling.sim.captures.info import CaptureInfo

Image = NDArray[np.float32]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Physics:
    """What repeated simulations of a scene say, all (h, w) in the left view."""

    ndp: Image  # Share of the draws without depth, 0 to 1.
    draws: int  # Number of draws; the share is known to 1 / draws.
    infrared: Image  # Simulated left image without noise, over full scale, 0 to 1.
    contrast: Image  # Local deviation of that image over its local mean.
    disparity_px: Image  # Mean of the draws that have one; NaN where none has.
    one_draw_px: (
        Image  # Disparity of the first draw that has one, with all its noise; NaN likewise.
    )
    one_draw_ndp: Mask  # Pixels without depth of the first draw: a frame as it comes.
    reason: NDArray[
        np.uint32
    ]  # The most frequent reason (`starling.sim.reason`) of no depth; 0 for depth.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Example:
    """A scene, known by its reference depth in the left view."""

    scene: str
    room: str  # Splits go by room.
    info: CaptureInfo  # Image size, intrinsics, baseline.
    depth_m: Image  # (h, w) reference depth; NaN where unknown.
    reflectance: Image | None = None  # (h, w) near-infrared, 0 to 1, smoothed until no dot is left.
    ndp: Mask | None = None  # (h, w) where the device has no depth; None where it is asked for.
    counted: Mask | None = None  # (h, w) where `ndp` counts; None as `ndp`.
    physics: Physics | None = None

    @property
    def simulated_error_px(self) -> Image | None:
        """Disparity of one simulated draw less the reference's (h, w); None without physics."""
        if self.physics is None:
            return None
        return self.physics.one_draw_px - self.info.disparity_px(self.depth_m)
