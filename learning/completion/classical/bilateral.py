"""Mean of nearby valid pixels of similar colour, from coarse to fine.

Normalised convolution (Knutsson and Westin, Normalized and differential convolution, CVPR 1993):
the filtered known depth is divided by the filtered mask. The filter is the joint bilateral one.
A window as wide as the widest hole would be slow. Holes beyond the window take depth from a
coarser image, filtered again by the finer one (Kopf et al., Joint bilateral upsampling,
SIGGRAPH 2007).
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.learning.completion.classical.outcome import completed, guide, inverse, trusted
from starling.learning.completion.frame import CompletionFrame, Image
from starling.learning.completion.method import Completed
from starling.patterns.errors import in_interval

_LEAST_PX = 8  # Least side of a coarser image.


@dataclass(frozen=True, kw_only=True, slots=True)
class Bilateral:
    """Joint bilateral filter, normalised."""

    sigma_px: float = 3.0  # Sigma of distance at each scale; the window reaches two sigma.
    sigma_level: float = 12.0  # Sigma of the image's difference [of 255].
    coarse_weight: float = 0.003  # Weight of the coarser image, relative to 1 of a valid pixel.
    guide_smoothing_px: float = 1.5  # Sigma of the Gaussian smoothing of the guide image.

    def __post_init__(self) -> None:
        in_interval("sigma_px", self.sigma_px, 0.5, 50.0)
        in_interval("sigma_level", self.sigma_level, 0.1, 1000.0)
        in_interval("coarse_weight", self.coarse_weight, 1e-6, 1.0)
        in_interval("guide_smoothing_px", self.guide_smoothing_px, 0.0, 50.0)

    @property
    def name(self) -> str:
        """`bilateral`."""
        return "bilateral"

    def fill(self, frame: CompletionFrame) -> Completed:
        """Complete a frame; valid pixels stay as they are."""
        image = guide(frame, self.guide_smoothing_px)
        known = trusted(frame)
        filled = self._filled(image, inverse(frame.depth_m, known), known.astype(np.float32))
        return completed(frame, 1 / filled)

    def _filled(self, image: NDArray[np.uint8], value: Image, weight: Image) -> Image:
        """Fill inverse depth (h, w) from values with weights; 0 is unknown."""
        height, width = weight.shape
        known = weight > 0
        if known.all():
            return value
        if min(height, width) < 2 * _LEAST_PX:
            coarse = np.full(weight.shape, (value * weight).sum() / weight.sum(), np.float32)
        else:
            size = ((width + 1) // 2, (height + 1) // 2)
            halved = _smaller(weight, size)
            mean = _smaller(value * weight, size) / np.maximum(halved, np.float32(1e-6))
            small = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)
            coarse = self._filled(small, np.where(halved > 0, mean, 0).astype(np.float32), halved)
            coarse = np.asarray(cv2.resize(coarse, (width, height)), np.float32)
        weights = np.where(known, weight, np.float32(self.coarse_weight))
        mixed = np.where(known, value, coarse)
        filled = self._smooth(image, mixed * weights) / self._smooth(image, weights)
        return np.where(known, value, filled)

    def _smooth(self, image: NDArray[np.uint8], values: Image) -> Image:
        reach = 2 * round(2 * self.sigma_px) + 1
        smooth = cv2.ximgproc.jointBilateralFilter(
            image.astype(np.float32), values, reach, self.sigma_level, self.sigma_px
        )
        return np.asarray(smooth, np.float32)


def _smaller(image: Image, size: tuple[int, int]) -> Image:
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.float32)
