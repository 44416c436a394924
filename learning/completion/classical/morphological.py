"""Depth extended into holes by grey-scale morphology, without the image.

Source: Ku, Harakeh and Waslander, In defense of classical image processing: fast depth completion
on the CPU, CRV 2018, section III, with the sizes given there. The extension of columns to the top
of the image, made for laser scanners outdoors, is omitted. The large fill is repeated until all
pixels are filled. Near surfaces grow into large holes, also where a stereo camera is occluded.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.learning.completion.classical.outcome import completed, trusted
from starling.learning.completion.frame import CompletionFrame, Image
from starling.learning.completion.method import Completed
from starling.patterns.errors import in_interval, refuse

_MARGIN_M = 1.0  # Distance of the farthest depth from the value "empty".


@dataclass(frozen=True, kw_only=True, slots=True)
class Morphological:
    """Dilation, closing, and fills of growing size; sides of square windows, odd."""

    diamond_px: int = 5  # First dilation, by a diamond.
    closing_px: int = 5  # Closing of small gaps.
    small_px: int = 7  # Small holes.
    large_px: int = 31  # Large holes, repeated until none remains.
    median_px: int = 5  # Against outliers: 1, 3 or 5.
    blur_px: int = 5  # Gaussian at the end; 1 = none.

    def __post_init__(self) -> None:
        for name in ("diamond_px", "closing_px", "small_px", "large_px", "median_px", "blur_px"):
            size = getattr(self, name)
            in_interval(name, size, 3 if name == "large_px" else 1, 255)
            if size % 2 == 0:
                raise refuse(name, "must be odd", size, "A window needs a centre pixel.")
        in_interval("median_px", self.median_px, 1, 5)

    @property
    def name(self) -> str:
        """`morphological`."""
        return "morphological"

    def fill(self, frame: CompletionFrame) -> Completed:
        """Complete a frame; valid pixels stay as they are."""
        # Inverted, so that dilation, a maximum, takes the nearest depth; 0 is empty.
        far = np.float32(np.nanmax(frame.depth_m) + _MARGIN_M)
        grown: Image = np.where(trusted(frame), far - frame.depth_m, np.float32(0))
        grown = _array(cv2.dilate(grown, _diamond(self.diamond_px)))
        grown = _array(cv2.morphologyEx(grown, cv2.MORPH_CLOSE, _square(self.closing_px)))
        grown = _into_empty(grown, self.small_px)
        while (grown == 0).any():
            grown = _into_empty(grown, self.large_px)
        if self.median_px > 1:
            grown = _array(cv2.medianBlur(grown, self.median_px))
        grown = _array(cv2.GaussianBlur(grown, (self.blur_px, self.blur_px), 0))
        return completed(frame, far - grown)


def _into_empty(grown: Image, size: int) -> Image:
    return np.where(grown == 0, _array(cv2.dilate(grown, _square(size))), grown)


def _square(size: int) -> NDArray[np.uint8]:
    return np.ones((size, size), np.uint8)


def _diamond(size: int) -> NDArray[np.uint8]:
    away = np.abs(np.arange(size) - size // 2)
    return (away[:, None] + away <= size // 2).astype(np.uint8)


def _array(image: object) -> Image:
    return np.asarray(image, np.float32)
