"""Input and target of a prediction method: one scene."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from starling.patterns.errors import refuse
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


def known_holes(example: Example) -> tuple[Mask, Mask]:
    """Return where the device has no depth, and which pixels count, both (h, w).

    Raises:
        InputError: if the example lacks one of them, or no pixel counts.
    """
    if example.ndp is None or example.counted is None:
        raise refuse(
            f"scene {example.scene}",
            "must have the device's depth and reference depth",
            "one or none",
            "Give captures with depth.png and truth.png.",
        )
    if not example.ndp.shape == example.counted.shape == example.depth_m.shape:
        raise refuse(
            f"ndp, counted and depth_m of scene {example.scene}",
            "must share one shape",
            f"{example.ndp.shape}, {example.counted.shape} and {example.depth_m.shape}",
            "Give all three of one view.",
        )
    if not example.counted.any():
        raise refuse(
            f"scene {example.scene}",
            "must have reference depth where the device can measure",
            "no pixel",
            "Leave it out, or check truth.png.",
        )
    return example.ndp, example.counted


def check_learnable(examples: Sequence[Example]) -> None:
    """Refuse examples that cannot be learnt from.

    Raises:
        InputError: if there is no example, an example has no known holes or no counted pixel;
            depth is known at all counted pixels or nowhere.
    """
    if not examples:
        raise refuse("examples", "must be at least one", 0, "Give captures for training.")
    holes = pixels = 0
    for example in examples:
        ndp, counted = known_holes(example)
        holes += np.count_nonzero(ndp & counted)
        pixels += np.count_nonzero(counted)
    if not 0 < holes < pixels:
        raise refuse(
            "no-depth pixels",
            "must be some and not all of the counted ones",
            f"{holes} of {pixels}",
            "Use scenes with both; a constant cannot be learnt.",
        )
