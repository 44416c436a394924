"""The result of a match: disparities, validity, and reasons for missing ones."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from starling.patterns.errors import refuse


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class DisparityMap:
    """Disparity of the left image, x_left - x_right.

    Attributes:
        disparity_px: (h, w) float32 [px], NaN without disparity.
        valid: (h, w) bool, True with disparity.
        reason: (h, w) uint32 codes of `starling.sim.reason`, 0 if and only if valid.
    """

    disparity_px: NDArray[np.float32]
    valid: NDArray[np.bool_]
    reason: NDArray[np.uint32]

    def __post_init__(self) -> None:
        shapes = {self.disparity_px.shape, self.valid.shape, self.reason.shape}
        if len(shapes) != 1:
            raise refuse(
                "disparity_px, valid and reason",
                "must share one shape",
                " ".join(map(str, sorted(shapes))),
                "Take all three from one match.",
            )
