"""Weighted least squares along rows and columns, guided by the image.

Min et al., Fast global image smoothing based on weighted least squares, TIP 2014, in OpenCV's
implementation. As in its section V for sparse input, smoothed inverse depth is divided by the
smoothed mask.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from starling.learning.completion.classical.outcome import completed, guide, inverse, trusted
from starling.learning.completion.frame import CompletionFrame
from starling.learning.completion.method import Completed
from starling.patterns.errors import in_interval
from starling.sim.arrays import filled

_REACHED = 1e-6  # Least share of a valid pixel's weight at a filled pixel.


@dataclass(frozen=True, kw_only=True, slots=True)
class WeightedLeastSquares:
    """Fast global smoother, normalised."""

    smoothness: float = 100.0  # Lambda: extent of smoothing in uniform image regions.
    sigma_level: float = 3.0  # Sigma of the image's difference [of 255].
    guide_smoothing_px: float = 1.5  # Sigma of the Gaussian smoothing of the guide image.

    def __post_init__(self) -> None:
        in_interval("smoothness", self.smoothness, 0.1, 1e6)
        in_interval("sigma_level", self.sigma_level, 0.1, 1000.0)
        in_interval("guide_smoothing_px", self.guide_smoothing_px, 0.0, 50.0)

    @property
    def name(self) -> str:
        """`wls`."""
        return "wls"

    def fill(self, frame: CompletionFrame) -> Completed:
        """Complete a frame; valid pixels stay unchanged.

        Pixels enclosed by edges that no valid pixel's weight reaches take the nearest reached
        depth.
        """
        known = trusted(frame)
        smoother = cv2.ximgproc.createFastGlobalSmootherFilter(
            guide(frame, self.guide_smoothing_px),
            self.smoothness,
            self.sigma_level,
        )
        weight = np.asarray(smoother.filter(known.astype(np.float32)), np.float32)
        value = np.asarray(smoother.filter(inverse(frame.depth_m, known)), np.float32)
        reached = (weight > _REACHED) | known
        depth = np.ones(frame.shape, np.float32)
        np.divide(weight, value, out=depth, where=weight > _REACHED)
        return completed(frame, filled(np.where(known, frame.depth_m, depth), reached))
